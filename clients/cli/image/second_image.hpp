// Putting a registered image into a case: common to `bregma image register --into` and `bregma image add`.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "algorithms/intensity/similarity_measure.hpp"
#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/image_registration.hpp"
#include "casefile/volumes/structures.hpp"

namespace bregma::cli {

// Markups whose points were placed in the image, in its coordinates. Empty: none.
struct PlanFiles {
  std::string targets, trajectories, landmarks, brain_landmarks;
};

struct SecondImage {
  std::filesystem::path source;
  std::string name;
  std::string accepted; // why a registration is used whose verdict is not found; may be empty
  PlanFiles plans;
  casefile::Segmentation segmentation;                 // drawn on the image; without labels there is none
  std::optional<casefile::Space> space = std::nullopt; // of labels that do not state it
  int vertices = 5000;                                 // maximum per structure
};

// Reads the case, adds the image and its points, and saves it. Points of a name that is already placed in this image
// are replaced, as are structures. An image of the name is replaced only with `replace`. notes: receives what was
// assumed. Blocks for seconds with a segmentation.
[[nodiscard]] base::Result<casefile::Case> add_to_case(const std::filesystem::path &folder, const SecondImage &image,
                                                       const intensity::Volume &volume,
                                                       const casefile::ImageRegistration &registration, bool replace,
                                                       std::vector<std::string> &notes);

// What was placed or made in the image, by kind and name: "target Cyst", "structure Vessel", "the brain".
[[nodiscard]] std::vector<std::string> placed_in(const casefile::Case &c, const std::string &image);

// "T2: predicted error 0.35 mm RMS at the centre of the head, 0.41 mm at 60 mm from it" and the points placed in it.
[[nodiscard]] std::string image_text(const casefile::Case &c, const casefile::RegisteredImage &image);
[[nodiscard]] nlohmann::json image_json(const casefile::Case &c, const casefile::RegisteredImage &image);
[[nodiscard]] nlohmann::json identity_json(const casefile::ImageIdentity &identity);

} // namespace bregma::cli
