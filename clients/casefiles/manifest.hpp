// The manifest of a case: the JSON of /case without addresses, in which each file states its hash and size
// (docs/gateway.md). It comes from outside, so its form is checked before it is used.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "base/result.hpp"
#include "clients/casefiles/download.hpp"

namespace bregma::casefiles {

struct Manifest {
  std::string id;                      // of the case
  std::map<std::string, FileId> files; // by "image", "labels" and "mesh/NAME"
  std::string json;                    // of /case: with addresses, and the manifest's hash
};

inline constexpr std::size_t kMaxManifestBytes = std::size_t{4} << 20;
inline constexpr std::size_t kMaxFiles = 256;

[[nodiscard]] base::Result<Manifest> read_manifest(std::string_view text);

} // namespace bregma::casefiles
