#include "clients/cli/case/case_parts.hpp"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

constexpr CasePart kImage{"image", "--image", "the image of the whole head, in which everything is planned", true};
constexpr CasePart kFiducials{"fiducials", "--fiducials",
                              "points on the head that are touched to register the patient: at least 3, better 6 to 8",
                              true};
constexpr CasePart kTools{"tools", "--tools", "the reference on the head and the tools that the tracker follows", true};
constexpr CasePart kPointer{"pointer", "--tools", "a tool of the role pointer or probe, whose tip is shown", true};
constexpr CasePart kLandmarks{"landmarks", "--landmarks",
                              "points on the head whose touch verifies a registration: it cannot be confirmed without",
                              true};
constexpr CasePart kTargets{"targets", "--targets", "points at which the accuracy is predicted", false};
constexpr CasePart kTrajectories{"trajectories", "--trajectories",
                                 "planned lines to the targets, for depth and lateral deviation", false};
constexpr CasePart kStructures{"structures", "--labels", "critical structures, whose distance from the tip is shown",
                               false};
constexpr CasePart kBrainPart{"brain", "--brain", "the tissue model, which predicts brain shift; navigation needs none",
                              false};

} // namespace

std::vector<CasePart> parts_to_give(const casefile::CaseSources &sources) {
  std::vector<CasePart> out;
  if (sources.image.empty()) {
    out.push_back(kImage);
  }
  if (sources.fiducials.empty()) {
    out.push_back(kFiducials);
  }
  if (sources.tools.empty()) {
    out.push_back(kTools);
  }
  return out;
}

std::vector<CasePart> missing_parts(const casefile::Case &c) {
  const bool pointer = std::any_of(c.tools.begin(), c.tools.end(), [](const casefile::ToolModel &tool) {
    return tool.role != casefile::ToolRole::kReference;
  });
  std::vector<CasePart> out;
  for (const auto &[there, part] :
       {std::pair{pointer, kPointer}, std::pair{!c.landmarks.empty(), kLandmarks},
        std::pair{!c.targets.empty(), kTargets}, std::pair{!c.trajectories.empty(), kTrajectories},
        std::pair{!c.structures.empty(), kStructures}, std::pair{!c.brain.mesh.triangles.empty(), kBrainPart}}) {
    if (!there) {
      out.push_back(part);
    }
  }
  return out;
}

std::string parts_text(const std::vector<CasePart> &parts) {
  Table table({"missing", "what it is for", "option"});
  for (const CasePart &part : parts) {
    table.row({part.name, std::string(part.purpose) + (part.navigation ? " (needed to navigate)" : ""), part.option});
  }
  return parts.empty() ? "" : table.text();
}

nlohmann::json parts_json(const std::vector<CasePart> &parts) {
  nlohmann::json out = nlohmann::json::array();
  for (const CasePart &part : parts) {
    out.push_back({{"part", part.name},
                   {"purpose", part.purpose},
                   {"option", part.option},
                   {"needed_to_navigate", part.navigation}});
  }
  return out;
}

} // namespace bregma::cli
