#include "clients/casefiles/manifest.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

namespace bregma::casefiles {
namespace {

using nlohmann::json;

bool plain(std::string_view name) {
  return !name.empty() && name.size() < 64 && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return c > 0x20 && c != '/' && c != '?' && c != '#' && c != '%' && c < 0x7f;
  });
}

// Adds the file of this entry under its name, and its address to the entry.
base::Result<void> add_file(Manifest &out, json &entry, const std::string &name, const std::string &case_hash) {
  const auto hash = entry.is_object() && entry.contains("sha256") && entry["sha256"].is_string()
                        ? from_hex(entry["sha256"].get_ref<const std::string &>())
                        : std::nullopt;
  if (!hash || !entry.contains("bytes") || !entry["bytes"].is_number_unsigned()) {
    return base::failure("manifest: \"" + name + "\" does not state sha256 and bytes");
  }
  if (out.files.size() >= kMaxFiles || !out.files.emplace(name, FileId{*hash, entry["bytes"]}).second) {
    return base::failure("manifest: \"" + name + "\" is there twice, or there are more than " +
                         std::to_string(kMaxFiles) + " files");
  }
  entry["url"] = "/case/" + case_hash + "/" + name;
  return {};
}

} // namespace

base::Result<Manifest> read_manifest(std::string_view text) {
  json root = text.size() <= kMaxManifestBytes ? json::parse(text, nullptr, false) : json(json::value_t::discarded);
  if (!root.is_object() || !root.contains("id") || !root["id"].is_string() || !root.contains("meshes") ||
      !root["meshes"].is_array() || (root.contains("images") && !root["images"].is_array())) {
    return base::failure("manifest: not a JSON object with \"id\" and \"meshes\", or \"images\" is no list");
  }
  Manifest out;
  out.id = root["id"];
  const std::string hash = to_hex(sha256(text));
  for (const char *name : {"image", "labels"}) {
    if (root.contains(name) && !root[name].is_null()) {
      if (auto added = add_file(out, root[name], name, hash); !added) {
        return tl::unexpected(added.error());
      }
    }
  }
  for (const auto &[list, folder] : {std::pair{"meshes", "mesh/"}, std::pair{"images", "image/"}}) {
    if (!root.contains(list)) {
      continue;
    }
    for (json &entry : root[list]) {
      if (!entry.is_object() || !entry.contains("file") || !entry["file"].is_string() ||
          !plain(entry["file"].get_ref<const std::string &>())) {
        return base::failure(std::string("manifest: an entry of \"") + list +
                             "\" states no file that can be a part of an address");
      }
      if (auto added = add_file(out, entry, folder + entry["file"].get<std::string>(), hash); !added) {
        return tl::unexpected(added.error());
      }
    }
  }
  root["hash"] = hash;
  out.json = root.dump(-1, ' ', false, json::error_handler_t::replace);
  return out;
}

} // namespace bregma::casefiles
