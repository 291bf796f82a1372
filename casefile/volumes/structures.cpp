#include "casefile/volumes/structures.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <string_view>
#include <system_error>

#include "base/text.hpp"
#include "casefile/volumes/label_check.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

std::optional<std::int16_t> region_number(const std::string &region, const LabelNames &names) {
  for (const auto &[value, name] : names) {
    if (name == region && value > 0 && value <= std::numeric_limits<std::int16_t>::max()) {
      return static_cast<std::int16_t>(value);
    }
  }
  const auto value = base::parsed_number<std::int16_t>(region);
  return value && *value > 0 ? value : std::nullopt;
}

fs::path label_table_of(const fs::path &labels) {
  fs::path table = labels;
  if (table.extension() == ".gz") {
    table.replace_extension();
  }
  return table += ".txt";
}

struct NamedRegions {
  LabelNames names;
  LabelColours colours;
  std::string from; // file or atlas
};

// Of a known atlas, of the file that is given, or of one beside the labels.
base::Result<NamedRegions> read_names(const Segmentation &segmentation) {
  if (auto known = known_label_names(segmentation.label_names.string())) {
    return NamedRegions{std::move(*known), {}, "the atlas " + segmentation.label_names.string()};
  }
  std::error_code ignored;
  const bool given = !segmentation.label_names.empty();
  const fs::path file = given ? segmentation.label_names : label_table_of(segmentation.labels);
  if (!given && !fs::exists(file, ignored)) {
    return NamedRegions{{}, {}, file.string()};
  }
  return read_label_names(file).map([&file](LabelNames &&names) {
    return NamedRegions{std::move(names), read_label_colours(file), file.string()};
  });
}

} // namespace

Progress within(const Progress &progress, double from, double to, const std::string &what) {
  if (!progress) {
    return {};
  }
  return [&progress, from, to, what](double done, std::string_view stage) {
    return progress(from + (to - from) * done, what.empty() ? std::string(stage) : what + ": " + std::string(stage));
  };
}

base::Result<StructureRequest> parse_structure(const std::string &text) {
  StructureRequest request;
  const std::size_t equals = text.find('=');
  request.name = text.substr(0, equals);
  const std::string regions = equals == std::string::npos ? text : text.substr(equals + 1);
  for (std::size_t from = 0; from <= regions.size();) {
    const std::size_t comma = std::min(regions.find(',', from), regions.size());
    request.regions.push_back(regions.substr(from, comma - from));
    from = comma + 1;
  }
  const bool empty =
      std::any_of(request.regions.begin(), request.regions.end(), [](const auto &r) { return r.empty(); });
  if (request.name.empty() || empty) {
    return base::failure("structure \"" + text + "\": must be Region or Name=Region,Region,...");
  }
  return request;
}

std::vector<StructureRequest> critical_structures(const LabelNames &names) {
  struct Atlas {
    // Of a region's name, around its own: the left and the right side.
    std::array<std::string, 2> before, after;
    std::vector<StructureRequest> kinds;
  };
  const std::array<Atlas, 4> atlases{
      {{{"", ""},
        {"_L", "_R"},
        {{"Precentral gyrus", {"Precentral"}},
         {"Occipital lobe", {"Calcarine", "Cuneus", "Lingual", "Occipital_Sup", "Occipital_Mid", "Occipital_Inf"}},
         {"Heschl gyrus", {"Heschl"}}}},
       {{"ctx-lh-", "ctx-rh-"},
        {"", ""},
        {{"Precentral gyrus", {"precentral"}},
         {"Occipital lobe", {"lateraloccipital", "cuneus", "pericalcarine", "lingual"}},
         {"Heschl gyrus", {"transversetemporal"}}}},
       {{"Left ", "Right "},
        {"", ""},
        {{"Precentral gyrus", {"PrG precentral gyrus"}},
         {"Occipital lobe",
          {"Calc calcarine cortex", "Cun cuneus", "LiG lingual gyrus", "IOG inferior occipital gyrus",
           "MOG middle occipital gyrus", "OCP occipital pole", "SOG superior occipital gyrus"}},
         {"Heschl gyrus", {"TTG transverse temporal gyrus"}}}},
       {{"", ""},
        {"_l", "_r"},
        {{"Precentral gyrus", {"FL_precen_G"}}, {"Occipital lobe", {"OL_rest_lat", "OL_ling_G", "OL_cuneus"}}}}}};
  const auto has = [&names](const std::string &region) {
    return std::any_of(names.begin(), names.end(), [&region](const auto &entry) { return entry.second == region; });
  };
  const auto found = std::find_if(atlases.begin(), atlases.end(), [&has](const Atlas &atlas) {
    return has(atlas.before[0] + atlas.kinds.front().regions.front() + atlas.after[0]);
  });
  const Atlas &atlas = found != atlases.end() ? *found : atlases.front();
  std::vector<StructureRequest> requests;
  for (const StructureRequest &kind : atlas.kinds) {
    for (const std::size_t side : {0U, 1U}) {
      StructureRequest request{kind.name + (side == 0 ? " L" : " R"), kind.regions};
      for (std::string &region : request.regions) {
        region = atlas.before[side] + region + atlas.after[side];
      }
      requests.push_back(std::move(request));
    }
  }
  return requests;
}

base::Result<StructureMaker> StructureMaker::read(const Segmentation &segmentation, std::optional<Space> space,
                                                  std::vector<std::string> *notes) {
  StructureMaker out;
  if (segmentation.labels.empty()) {
    return segmentation.structures.empty() ? base::Result<StructureMaker>(std::move(out))
                                           : base::failure("structures are asked for, but there is no label image");
  }
  auto labels = read_labels(segmentation.labels, {.space = space}, notes);
  if (!labels) {
    return tl::unexpected(labels.error());
  }
  auto named = read_names(segmentation);
  if (!named) {
    return tl::unexpected(named.error());
  }
  for (const StructureRequest &request :
       segmentation.structures.empty() ? critical_structures(named->names) : segmentation.structures) {
    std::vector<std::int16_t> regions;
    for (const std::string &region : request.regions) {
      const auto number = region_number(region, named->names);
      if (!number) {
        return base::failure(segmentation.labels.string() + ": structure \"" + request.name +
                             "\": there is no region \"" + region + "\" in " +
                             (named->names.empty() ? "it; no names are known" : named->from));
      }
      regions.push_back(*number);
    }
    out.regions_.emplace_back(request.name, std::move(regions));
  }
  out.file_ = segmentation.labels;
  out.labels_ = std::move(*labels);
  out.names_ = std::move(named->names);
  out.colours_ = std::move(named->colours);
  return out;
}

std::vector<std::string> StructureMaker::doubts(const Volume &image) const {
  std::vector<std::string> out;
  if (!empty()) {
    out = label_doubts(labels_, names_, image);
  }
  for (std::string &doubt : out) {
    doubt = file_.string() + ": the labels " + doubt;
  }
  return out;
}

base::Result<StructureMaker::Made> StructureMaker::make(int vertices, const Progress &progress) const {
  SurfaceOptions options;
  options.closing_mm = 1.0;
  options.blur_mm = 0.7; // more blur would erode thin gyri
  options.vertices = vertices;
  Made out;
  const double share = 1.0 / static_cast<double>(std::max<std::size_t>(regions_.size(), 1));
  double from = 0.0;
  for (const auto &[name, regions] : regions_) {
    auto named = named_surface(extract_surface(labels_, regions, options, within(progress, from, from + share, name)),
                               name, file_);
    if (!named) {
      return tl::unexpected(named.error());
    }
    out.surfaces.push_back(std::move(named->first));
    out.summaries.push_back(std::move(named->second));
    from += share;
  }
  return out;
}

base::Result<std::pair<Surface, SurfaceSummary>> named_surface(base::Result<ExtractedSurface> extracted,
                                                               const std::string &name, const fs::path &source) {
  if (!extracted) {
    return base::failure(source.string() + ": surface \"" + name + "\": " + extracted.error().message);
  }
  SurfaceSummary summary{name, static_cast<int>(extracted->mesh.vertices_mm.size()), extracted->report};
  return std::pair{Surface{name, std::move(extracted->mesh)}, std::move(summary)};
}

} // namespace bregma::casefile
