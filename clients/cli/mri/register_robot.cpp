// `bregma mri register`: the robot's base registered to the scanner by active coils, from files.
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/mri/coils/field_correction.hpp"
#include "casefile/volumes/scan_fields_file.hpp"
#include "clients/cli/mri/field_use.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/mri/read_out.hpp"
#include "clients/cli/mri/register_watch.hpp"
#include "clients/cli/mri/scan_list.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using Eigen::Vector3d;
using nlohmann::json;

struct RegisterArguments {
  std::string scans, field;
  bool watch = false, until_end = false, until_wait = false;
  FieldConsent consent;
  std::string method = "multi-slice";
  double limit_mm = mri::RobotRegistrationOptions().limit_mm;
  double distortion_mm = mri::RobotRegistrationOptions().uncorrected_sigma_mm;
};

mri::CoilMethod method_of(const std::string &name) {
  return name == "hough"          ? mri::CoilMethod::kHoughCircles
         : name == "single-slice" ? mri::CoilMethod::kSingleSlice
                                  : mri::CoilMethod::kMultiSlice;
}

// "-" for an artefact without a name.
std::string coil_name(const mri::LocatedCoil &c, const ScanList &list) {
  return c.coil < 0 ? "-" : list.frame.coils[static_cast<std::size_t>(c.coil)].name;
}

json coils_json(const std::vector<mri::LocatedCoil> &coils, const ScanList &list) {
  json out = json::array();
  for (const mri::LocatedCoil &c : coils) {
    out.push_back({{"coil", c.coil < 0 ? json() : json(coil_name(c, list))},
                   {"scan", list.scans[static_cast<std::size_t>(c.scan)].name},
                   {"shown_device_mm", json_vector(c.shown_mm)},
                   {"device_mm", json_vector(c.position_mm)},
                   {"covariance_mm2", json_matrix(c.covariance)},
                   {"residual_mm", json_number(c.residual_mm)},
                   {"used", c.used}});
  }
  return out;
}

json to_json(const mri::RobotRegistration &r, const ScanList &list) {
  json out = {{"accepted", r.verdict == mri::RegistrationVerdict::kFound},
              {"verdict", mri::name(r.verdict)},
              {"reason", r.reason},
              {"notes", r.notes},
              {"frame", list.frame.name},
              {"coils", coils_json(r.coils, list)}};
  if (r.verdict == mri::RegistrationVerdict::kFound || r.verdict == mri::RegistrationVerdict::kInaccurate) {
    out["T_base_device"] = json_matrix(r.T_base_device.pose.matrix());
    out["covariance"] = json_matrix(r.T_base_device.covariance);
    out["fre_mm"] = json_number(r.fre_mm);
    out["fre_expected_mm"] = json_number(r.fre_expected_mm);
    out["p_value"] = json_number(r.p_value);
    out["predicted_error_95_mm"] = json_number(r.tre_95_mm);
    out["out_of_plane_mm"] = json_number(r.opme_mm);
    out["verified"] = coils_json(r.verified, list);
    out["verified_rms_mm"] = json_number(r.verified_mm);
    out["b0_change_mm"] = json_number(r.b0_change_mm);
  }
  if (r.verdict != mri::RegistrationVerdict::kFound) {
    withhold(out, {"T_base_device", "covariance"});
  }
  return out;
}

std::string to_text(const mri::RobotRegistration &r, const ScanList &list) {
  std::string out = "Registration of " + list.frame.name + " " + mri::name(r.verdict) +
                    (r.reason.empty() ? "" : ": " + r.reason) + "\n\n";
  for (const std::string &note : r.notes) {
    out += note + "\n";
  }
  if (r.coils.empty()) {
    return out;
  }
  Table table({"Coil", "Scan", "x mm", "y mm", "z mm", "Residual mm", ""});
  const auto rows = [&](const std::vector<mri::LocatedCoil> &coils, const char *used) {
    for (const mri::LocatedCoil &c : coils) {
      table.row({coil_name(c, list), list.scans[static_cast<std::size_t>(c.scan)].name, fixed(c.position_mm.x(), 2),
                 fixed(c.position_mm.y(), 2), fixed(c.position_mm.z(), 2),
                 c.residual_mm > 0.0 ? fixed(c.residual_mm, 2) : "-", c.used ? used : "not used"});
    }
  };
  rows(r.coils, "");
  rows(r.verified, "verifies");
  out += (r.notes.empty() ? "" : "\n") + table.text();
  if (r.verdict == mri::RegistrationVerdict::kFound || r.verdict == mri::RegistrationVerdict::kInaccurate) {
    out += "\nPredicted error at the target " + fixed(r.tre_95_mm, 2, "mm") +
           " (95 %)\nConsistency of the coils (FRE) " + fixed(r.fre_mm, 2, "mm") + ", expected " +
           fixed(r.fre_expected_mm, 2, "mm") + ", p " + fixed(r.p_value, 3) + "; out of plane " +
           fixed(r.opme_mm, 2, "mm") + "\n";
    if (!r.verified.empty()) {
      out += "Coils that verify: RMS " + fixed(r.verified_mm, 2, "mm") + ", the error of finding them included\n";
    }
    if (std::isfinite(r.b0_change_mm)) {
      out += "B0 has changed by up to " + fixed(r.b0_change_mm, 2, "mm") +
             " at a coil since it was mapped: so far off are images of one read-out\n";
    }
  }
  return out;
}

// Reads the field, asks whether it may be applied to every image, and corrects by the part of it that displaces these
// scans.
base::Result<void> use_field(const RegisterArguments &arguments, const ScanList &list,
                             mri::RobotRegistrationOptions &options) {
  const auto field = casefile::read_scan_fields(arguments.field);
  if (!field) {
    return tl::unexpected(field.error());
  }
  for (const std::string &file : list.files) {
    if (const auto use = check_field_use(arguments.field, field->header, file, {}, arguments.consent); !use) {
      return tl::unexpected(use.error());
    }
  }
  const auto position = mri::parse_patient_position(field->header.patient_position);
  if (!position) {
    return base::failure(position.error());
  }
  const auto T_device_ras = [](mri::PatientPosition of) {
    return mri::T_device_patient(of) * mri::T_image_patient().inverse();
  };
  const auto T_field_device = T_device_ras(*position).inverse();
  // Of the scans, in the frame of the field.
  std::optional<Vector3d> mm_per_Hz;
  if (list.mm_per_Hz) {
    mm_per_Hz = T_field_device.rotation() * (T_device_ras(list.position).rotation() * *list.mm_per_Hz);
  }
  const mri::ScanFields &fields = field->fields;
  if (list.opposed() && !fields.has_b0()) {
    return base::failure(arguments.field + ": holds B0 of one read-out, which scans with both read-outs do not show; "
                                           "make it by `bregma mri field` from scans of the phantom with both");
  }
  if (mm_per_Hz && fields.is_opposite(*mm_per_Hz)) {
    return base::failure(arguments.field + ": was measured with the opposite read-out, so B0 would be doubled");
  }
  const std::string note = list.opposed() ? "" : b0_note(fields, mm_per_Hz, "read_out in " + arguments.scans);
  if (!note.empty()) {
    print_notes({arguments.field + ": " + note});
  }
  options.correction =
      mri::correction_by(list.opposed() || !mm_per_Hz ? fields.table() : fields.of_scan(*mm_per_Hz), *position);
  if (list.opposed() && mm_per_Hz) {
    options.mapped_b0 = mri::mapped_b0(fields, *position, *mm_per_Hz);
  }
  return {};
}

int run_register(const RegisterArguments &arguments, const Context &context) {
  if (arguments.watch) {
    return watch_registration(arguments.until_end    ? WatchUntil::kAccepted
                              : arguments.until_wait ? WatchUntil::kOperator
                                                     : WatchUntil::kDaemonEnds,
                              context);
  }
  if (arguments.scans.empty()) {
    return fail("a list of scans, or --watch, is needed");
  }
  std::vector<std::string> notes;
  const auto list = read_scan_list(arguments.scans, &notes);
  print_notes(notes);
  if (!list) {
    return fail(list.error());
  }
  mri::RobotRegistrationOptions options;
  options.artefacts.method = method_of(arguments.method);
  options.limit_mm = arguments.limit_mm;
  options.uncorrected_sigma_mm = arguments.distortion_mm;
  if (list->frame.R_patient_base) {
    const Eigen::Matrix3d R_device_base =
        mri::T_device_patient(list->position).rotation_matrix() * *list->frame.R_patient_base;
    options.expected_rotation = Eigen::Quaterniond(R_device_base.transpose());
  }
  if (auto one = check_coil_images(list->files, mri::name(list->position)); !one) {
    return fail(one.error());
  }
  if (!arguments.field.empty()) {
    if (const auto used = use_field(arguments, *list, options); !used) {
      return fail(used.error());
    }
  }
  const mri::RobotRegistration r = mri::register_robot(list->frame, list->scans, options);
  if (context.json) {
    print_json(to_json(r, *list));
  } else {
    print(to_text(r, *list));
  }
  return r.verdict == mri::RegistrationVerdict::kFound ? kOk : kRefused;
}

} // namespace

void add_mri_register(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("register", "Registers the robot's base to the scanner by active coils");
  auto arguments = std::make_shared<RegisterArguments>();
  command->add_option("scans", arguments->scans, "List of scans (TOML): frame, orientation, background and foreground");
  auto *watch =
      command->add_flag("--watch", arguments->watch,
                        "Follow the registration that a running daemon guides: step, slices, what to do next");
  command->add_flag("--until-end", arguments->until_end, "End when it is accepted (exit code 0) or has failed (1)")
      ->needs(watch);
  command
      ->add_flag("--until-wait", arguments->until_wait,
                 "End when the daemon waits for the operator, or a step has failed")
      ->needs(watch);
  command->add_option("--field", arguments->field,
                      "Distortion field of the scanner, as `bregma mri field` writes it (NRRD)");
  command->add_flag("--not-corrected", arguments->consent.not_corrected,
                    "Images that do not state it were not corrected by the vendor");
  command->add_flag("--other-scanner", arguments->consent.other_scanner, "Accept a field of another scanner");
  command->add_flag("--expired", arguments->consent.expired, "Accept a field that has expired");
  command->add_option("--method", arguments->method, "How a coil is located")
      ->check(CLI::IsMember({"multi-slice", "hough", "single-slice"}))
      ->capture_default_str();
  command->add_option("--limit-mm", arguments->limit_mm, "Limit of the predicted 95 % error at the base's origin")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  command
      ->add_option("--distortion-mm", arguments->distortion_mm,
                   "Distortion of the images, 1 sigma of each coordinate, where it is not corrected")
      ->check(CLI::Range(0.01, 20.0))
      ->capture_default_str();
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer("The exit code is 1 unless the registration is found.\n\nExamples:\n"
                  "  bregma mri register scans.toml\n"
                  "  bregma mri register scans.toml --field field.nrrd --not-corrected\n"
                  "  bregma mri register scans.toml --method single-slice --json\n"
                  "  bregma mri register --watch");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_register(*arguments, context); }; });
}

} // namespace bregma::cli
