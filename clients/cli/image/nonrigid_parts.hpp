// The nonrigid part of `bregma image register`: its options, its run and its output.
#pragma once

#include <functional>
#include <string>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "algorithms/intensity/nonrigid_image.hpp"
#include "base/result.hpp"

namespace CLI {
class App;
class Option;
} // namespace CLI

namespace bregma::cli {

struct NonrigidArguments {
  bool wanted = false;
  double grid_mm = 20.0, bending = 100.0;
  std::string field; // file; empty: none
};
void add_nonrigid_options(CLI::App &command, NonrigidArguments &arguments, CLI::Option &excluded);

// From the pose of `rigid`, with the options of the rigid registration that apply.
[[nodiscard]] intensity::NonrigidImageResult deform(const intensity::Volume &target, const intensity::Volume &source,
                                                    const intensity::RigidImageOptions &options,
                                                    const NonrigidArguments &arguments,
                                                    const intensity::RigidImageResult &rigid, parallel::Team &team);

[[nodiscard]] nlohmann::json nonrigid_json(const intensity::NonrigidImageResult &result);
[[nodiscard]] std::string nonrigid_text(const intensity::NonrigidImageResult &result);

// The whole map from target to source (mm) as a displacement field of ITK and Slicer, over the target's box.
[[nodiscard]] base::Result<void> write_field(const std::string &path, const image::Grid<3> &target,
                                             const std::function<Eigen::Vector3d(const Eigen::Vector3d &)> &to_source);

} // namespace bregma::cli
