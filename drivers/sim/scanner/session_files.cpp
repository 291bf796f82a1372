#include "drivers/sim/scanner/session_files.hpp"

#include <fstream>
#include <functional>
#include <string>
#include <system_error>

#include <nlohmann/json.hpp>

#include "casefile/coil_frames.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::sim::scanner {

namespace {

using nlohmann::json;

// Device (left, up, feet) as RAS.
Stack in_ras(Stack stack) {
  stack.T_image_index.row(0) *= -1.0;
  stack.T_image_index.row(2) *= -1.0;
  return stack;
}

json vector(const Vector3d &v) { return {v.x(), v.y(), v.z()}; }
json matrix(const Eigen::Matrix4d &m) {
  json out = json::array();
  for (int r = 0; r < 4; ++r) {
    out.push_back({m(r, 0), m(r, 1), m(r, 2), m(r, 3)});
  }
  return out;
}

base::Result<void> write_text(const std::filesystem::path &file, const std::string &text) {
  std::ofstream out(file);
  out << text;
  out.close();
  return out ? base::Result<void>{} : base::failure(file.string() + ": cannot be written");
}

std::string truth_text(const SimulatedScanner &scanner, const Vector3d &frame_at_mm) {
  const Truth &truth = scanner.truth();
  json coils = json::object();
  for (std::size_t i = 0; i < scanner.design().size(); ++i) {
    coils[scanner.design()[i].name] = vector(truth.coils_device_mm[i]);
  }
  Eigen::Matrix4d T_frame_base = Eigen::Matrix4d::Identity();
  T_frame_base.topRightCorner<3, 1>() = -frame_at_mm;
  return json{{"T_device_base", matrix(truth.T_device_base.matrix() * T_frame_base)},
              {"T_device_phantom", matrix(truth.T_device_phantom.matrix())},
              {"T_ct_phantom", matrix(truth.T_ct_phantom.matrix())},
              {"coils_device_mm", coils}}
             .dump(1) +
         "\n";
}

mri::CoilFrame frame_of(const SimulatedScanner &scanner, const Vector3d &frame_at_mm) {
  mri::CoilFrame out;
  out.name = "tuna";
  Eigen::Matrix3d mounted; // x to the left, z (along the pillars) to the front
  mounted << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  out.R_patient_base = mounted;
  for (const CoilDesign &coil : scanner.design()) {
    out.coils.push_back({coil.name, coil.group, coil.position_mm + frame_at_mm});
  }
  return out;
}

using Save = std::function<base::Result<void>(const std::string &name, const Stack &stack)>;

// Background and foreground of top and bottom, and the list of them.
base::Result<void> write_scans(const std::filesystem::path &folder, SimulatedScanner &scanner,
                               const SessionFiles &files, const Save &save) {
  const Protocol protocol = coil_protocol(60);
  std::string scans = "frame = \"frame.toml\"\npatient_position = \"HFS\"\nread_out = \"L\"\nbandwidth_Hz = " +
                      std::to_string(static_cast<int>(protocol.bandwidth_Hz)) + "\n";
  for (const bool top : {true, false}) {
    const std::string side = top ? "top" : "bottom";
    StackPlan plan = plan_of(Plane::kCoronal, Vector3d(0, top ? 55 : -55, 0), 60);
    const std::vector<std::string> on{"mid-" + side, "inner-" + side};
    scans += "\n[[scans]]\nname = \"" + side + "\"\norientation = \"C\"\n";
    base::Result<void> done;
    const auto add = [&](const std::string &key, const std::string &name, const std::function<Stack()> &scan) {
      scans += key + " = \"" + name + "\"\n";
      done = done.and_then([&] { return save(name, scan()); });
    };
    add("background", side + "_off.nrrd", [&] { return scanner.background(protocol, plan); });
    add("foreground", side + "_on.nrrd", [&] { return scanner.foreground(protocol, plan, on); });
    if (files.reversed) {
      add("opposite", side + "_reversed.nrrd", [&] { return scanner.foreground(protocol, plan, on, -1); });
    }
    if (files.opposed) {
      plan.read_reversed = true;
      add("background_opposed", side + "_off_opposed.nrrd", [&] { return scanner.background(protocol, plan); });
      add("foreground_opposed", side + "_on_opposed.nrrd", [&] { return scanner.foreground(protocol, plan, on); });
    }
    if (!done) {
      return done;
    }
    scans += "on = [\"mid-" + side + "\", \"inner-" + side + "\"]\nverify = [\"inner-" + side + "\"]\n";
  }
  return write_text(folder / "scans.toml", scans);
}

} // namespace

base::Result<void> write_session(const std::filesystem::path &folder, SimulatedScanner &scanner,
                                 const SessionFiles &files) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) {
    return base::failure(folder.string() + ": " + failed.message());
  }
  const Save save = [&](const std::string &name, const Stack &stack) {
    return casefile::write_volume(folder / name,
                                  in_ras(files.vendor ? vendor_corrected(stack, scanner.field()) : stack));
  };
  base::Result<void> done = files.mr ? write_scans(folder, scanner, files, save) : base::Result<void>{};
  if (done && files.mr && files.phantom) {
    StackPlan plan = scanner.phantom_plan();
    done = save("phantom_mr.nrrd", scanner.phantom(phantom_protocol(), plan));
    if (done && files.opposed) {
      plan.read_reversed = true;
      done = save("phantom_mr_opposed.nrrd", scanner.phantom(phantom_protocol(), plan));
    }
  }
  if (done && files.phantom) { // the CT has no gradients to correct
    done = casefile::write_volume(folder / "phantom_ct.nrrd", in_ras(scanner.ct(files.ct_coarser)));
  }
  if (done) {
    done = write_text(folder / "frame.toml", casefile::coil_frame_text(frame_of(scanner, files.frame_at_mm)));
  }
  return done ? write_text(folder / "truth.json", truth_text(scanner, files.frame_at_mm)) : done;
}

} // namespace bregma::sim::scanner
