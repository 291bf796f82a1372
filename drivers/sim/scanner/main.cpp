// `bregma-sim-scanner`: writes a simulated session of an MR scanner as files.
#include <array>
#include <cstdio>
#include <exception>
#include <map>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "base/standard_output.hpp"
#include "drivers/sim/scanner/session_files.hpp"

namespace {

using namespace bregma::sim::scanner;

int run(int argc, char **argv) {
  CLI::App app("Simulated MR scanner: writes the scans of one session", "bregma-sim-scanner");
  std::string folder, field = "harmonics";
  std::uint64_t seed = 1;
  ScannerOptions options;
  SessionFiles files;
  app.add_option("--write", folder, "Folder for frame.toml, scans.toml, images and truth.json")->required();
  app.add_option("--seed", seed, "Decides the field and every hidden error")->capture_default_str();
  app.add_option("--field", field, "Shape of the gradients' errors")
      ->check(CLI::IsMember({"harmonics", "bumps", "none"}))
      ->capture_default_str();
  app.add_option("--distortion-mm", options.field.mean_mm, "Mean distortion of the phantom")
      ->check(CLI::Range(0.0, 5.0))
      ->capture_default_str();
  app.add_option("--b0-Hz", options.field.b0_Hz, "RMS deviation of the main field on the phantom")
      ->check(CLI::Range(0.0, 500.0))
      ->capture_default_str();
  app.add_option("--snr", options.appearance.snr, "Of water; 0: no noise")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--bubbles", options.errors.bubbles, "Air bubbles in the phantom")
      ->check(CLI::Range(0, 200))
      ->capture_default_str();
  app.add_option("--current-mA", options.current_mA, "Of each coil")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_flag("--phantom", files.phantom, "Also the phantom in CT and MR");
  app.add_option("--ct-coarser", files.ct_coarser, "Voxels of the CT, times those of the paper")
      ->check(CLI::Range(1.0, 8.0))
      ->capture_default_str();
  app.add_flag("--reversed", files.reversed, "Also foregrounds with the current reversed");
  app.add_flag("--opposed", files.opposed, "Also images with the read-out reversed, towards R instead of L");
  app.add_flag("!--no-mr", files.mr, "No MR images: only the frame, the truth and, with --phantom, its CT");
  std::array<double, 3> frame_at_mm{};
  app.add_option("--frame-at-mm", frame_at_mm, "Where the registration frame's origin lies in the robot's base")
      ->capture_default_str();
  app.add_flag("--vendor", files.vendor, "Images with the gradients corrected, as the scanner's vendor does");
  app.footer("Example:\n  bregma-sim-scanner --write session --seed 3\n  bregma mri register session/scans.toml");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return bregma::base::end_output("bregma-sim-scanner", app.exit(error) == 0 ? 0 : 2);
  }
  options.field.kind = field == "none"    ? FieldKind::kNone
                       : field == "bumps" ? FieldKind::kBumps
                                          : FieldKind::kHarmonics;
  options.field.max_mm = options.field.mean_mm * 4.14 / 1.20; // the paper's proportion
  files.frame_at_mm = Vector3d::Map(frame_at_mm.data());
  SimulatedScanner scanner(options, seed);
  if (const auto done = write_session(folder, scanner, files); !done) {
    std::fprintf(stderr, "bregma-sim-scanner: %s\n", done.error().message.c_str());
    return 2;
  }
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "bregma-sim-scanner: %s\n", error.what());
    return 2;
  }
}
