// The tables [[images]] of case.toml: images that were registered to the planning image. Private to this library.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/table_reader.hpp"
#include "casefile/case.hpp"
#include "casefile/case_check.hpp"

namespace bregma::casefile::detail {

// Files that a table [[images]] names, relative to the case's folder.
struct ImageFiles {
  std::string file, transform, landmarks, brain_landmarks, targets, trajectories;
};

// Fills what the table itself states.
[[nodiscard]] ImageFiles read_image(base::TableReader &reader, RegisteredImage &out);

// Reads the transform, and compares the image's file with the checksum.
[[nodiscard]] std::optional<CaseProblem> load_image(const std::filesystem::path &folder, const ImageFiles &files,
                                                    RegisteredImage &out, Checksums checksums);

// The planning image is not the one to which an image was registered.
[[nodiscard]] std::optional<CaseProblem> changed_planning_image(const Case &c);

// What is wrong with the images, and with points and surfaces that name them.
[[nodiscard]] std::optional<CaseProblem> images_problem(const Case &c);

// Writes the transforms and the plans that were placed in these images, and returns the tables.
[[nodiscard]] base::Result<std::string> save_images(const Case &c);

// The plan without what save_images writes.
[[nodiscard]] std::vector<NamedPoint> placed_in_planning_image(const std::vector<NamedPoint> &points);
[[nodiscard]] std::vector<Trajectory> written_with_the_plan(const Case &c);

// A file name that is valid on every file system from a name that the user entered; not one of `taken`, to which it is
// added.
[[nodiscard]] std::string file_stem(const std::string &name, std::set<std::string> &taken);

} // namespace bregma::casefile::detail
