// Arbitrary bytes as the file of what an arm carries, or as one of the calibrations that it names, the others being
// whole: nothing crashes, and what is accepted is finite, a direction of length 1, a rigid motion, a covariance.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Eigenvalues>

#include "casefile/robot_tools.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

void require_covariance(const Eigen::MatrixXd &C) {
  require(C.allFinite());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(C);
  require(solver.eigenvalues().minCoeff() >= -1e-6 * std::max(1.0, solver.eigenvalues().maxCoeff()));
}

class RobotFolder {
public:
  RobotFolder() {
    for (const char *name : kNames) {
      const std::string seed =
          tests::read_file(std::filesystem::path(BREGMA_SOURCE_DIR) / "tests/fuzz/seeds/robot_files" / name);
      whole_.push_back(seed.substr(1)); // without the digit that selects the file
      static_cast<void>(folder_.write(name, whole_.back()));
    }
    require(read());
  }
  void read_with(std::size_t file, std::string_view content) const {
    static_cast<void>(folder_.write(kNames[file], content));
    static_cast<void>(read());
    static_cast<void>(folder_.write(kNames[file], whole_[file]));
  }
  static constexpr const char *kNames[] = {"robot.toml", "beam.json", "curve.json", "hand_eye.json"};

private:
  [[nodiscard]] bool read() const {
    const auto equipment = casefile::read_robot_equipment(folder_.path() / kNames[0]);
    require(equipment || !equipment.error().message.empty());
    if (!equipment) {
      return false;
    }
    for (const auto &tool : equipment->tools) {
      require(tool.tip_mm.allFinite() && std::abs(tool.axis.norm() - 1.0) < 1e-6 && std::isfinite(tool.sigma_mm));
    }
    for (const auto &sensor : equipment->sensors) {
      require(sensor.origin_mm.allFinite() && std::abs(sensor.direction.norm() - 1.0) < 1e-3);
      require_covariance(sensor.covariance);
      if (sensor.curve) {
        require(sensor.curve->law.scale_mm > 0.0 && std::isfinite(sensor.curve->law.exponent) &&
                sensor.curve->rms_mm >= 0.0 && sensor.curve->corrected_rms_mm >= 0.0);
        for (const auto &correction : sensor.curve->corrections) {
          require(std::isfinite(correction.add_mm));
        }
        require_covariance(sensor.curve->covariance);
      }
    }
    if (equipment->hand_eye) {
      require(equipment->hand_eye->T_base_tracker.pose.translation().allFinite());
      require_covariance(equipment->hand_eye->joint);
    }
    return true;
  }

  test::TemporaryFolder folder_;
  std::vector<std::string> whole_; // contents, in the order of kNames
};

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const RobotFolder folder;
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data) + 1, size - 1);
  folder.read_with(static_cast<unsigned>(data[0] - '0') % 4, content); // the seeds begin with the digits 0 to 3
  return 0;
}
