// Critical structures from a label image: their regions by name or number, and closed surfaces around them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/volumes/label_names.hpp"
#include "casefile/volumes/label_regions.hpp"
#include "casefile/volumes/surface.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

// A critical structure: its name in the case and the regions of the label image that make it up, by name or number.
struct StructureRequest {
  std::string name;
  std::vector<std::string> regions;
};

// "Name=Region,Region" or "Region", which is then the structure's name as well.
[[nodiscard]] base::Result<StructureRequest> parse_structure(const std::string &text);

// Precentral gyri, occipital lobes and Heschl's gyri, each side apart, by the names of the atlas whose names these are:
// AAL, FreeSurfer (Desikan-Killiany), Neuromorphometrics or Hammers (which has no Heschl's gyrus); AAL if of none.
[[nodiscard]] std::vector<StructureRequest> critical_structures(const LabelNames &names);

struct Segmentation {
  std::filesystem::path labels;             // regions; empty: there are no structures
  std::filesystem::path label_names;        // or one of known_atlases(); empty: next to the labels, ".txt" for ".gz"
  std::vector<StructureRequest> structures; // empty: critical_structures()
};

struct SurfaceSummary {
  std::string name;
  int vertices = 0;
  SurfaceReport report;
};

// Structures of a segmentation, in the coordinates of its own image (RAS, mm). Empty without labels.
class StructureMaker {
public:
  StructureMaker() = default;
  // Reads the labels and finds the regions. Errors name file, structure and region. notes: receives what was assumed.
  [[nodiscard]] static base::Result<StructureMaker> read(const Segmentation &segmentation, std::optional<Space> space,
                                                         std::vector<std::string> *notes);

  [[nodiscard]] bool empty() const { return regions_.empty(); }
  // Sentences on what is doubtful about the labels beside this image (label_doubts), with the labels' file.
  [[nodiscard]] std::vector<std::string> doubts(const Volume &image) const;

  // The label image, and its regions with their colours.
  [[nodiscard]] const LabelVolume &labels() const { return labels_; }
  [[nodiscard]] LabelRegions regions() const { return regions_in(labels_, names_, colours_); }

  struct Made {
    std::vector<Surface> surfaces;
    std::vector<SurfaceSummary> summaries;
  };
  // vertices: maximum per structure. Blocks for seconds.
  [[nodiscard]] base::Result<Made> make(int vertices, const Progress &progress) const;

private:
  std::filesystem::path file_;
  LabelVolume labels_;
  LabelNames names_;
  LabelColours colours_;
  std::vector<std::pair<std::string, std::vector<std::int16_t>>> regions_; // by structure
};

// The surface with its summary, or the error with file and name.
[[nodiscard]] base::Result<std::pair<Surface, SurfaceSummary>>
named_surface(base::Result<ExtractedSurface> extracted, const std::string &name, const std::filesystem::path &source);

// A part of a progress, from one fraction to another, whose stages begin with these words, if any.
[[nodiscard]] Progress within(const Progress &progress, double from, double to, const std::string &what);

} // namespace bregma::casefile
