// Regions of a label image as displays draw them: name and colour, in a table beside the image.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

#include "base/result.hpp"
#include "casefile/volumes/label_names.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

struct LabelRegion {
  std::string name;
  std::uint32_t colour = 0; // 0xRRGGBB
  friend bool operator==(const LabelRegion &, const LabelRegion &) = default;
};
using LabelRegions = std::map<int, LabelRegion>; // by number, above 0

using LabelColours = std::map<int, std::uint32_t>;

// Colours of a table that states them: FreeSurfer's colour table, or ITK-SNAP's label descriptions. Regions without a
// colour are left out; so is a file without any, or that cannot be read.
[[nodiscard]] LabelColours read_label_colours(const std::filesystem::path &file);

// Every region that has a voxel. One without a name is "region N"; one without a colour gets one that differs from
// those of the numbers near it.
[[nodiscard]] LabelRegions regions_in(const LabelVolume &labels, const LabelNames &names, const LabelColours &colours);

// ITK-SNAP's label descriptions, which other programs read as well. Quotes and control characters in names are
// replaced.
[[nodiscard]] base::Result<void> write_label_regions(const std::filesystem::path &file, const LabelRegions &regions);

// A table of any format of read_label_names; a region without a colour gets one as above.
[[nodiscard]] base::Result<LabelRegions> read_label_regions(const std::filesystem::path &file);

} // namespace bregma::casefile
