// `bregma mri field`: the distortion field of a scanner from control points of a phantom in CT and one or more MR
// scans.
#include <chrono>
#include <ctime>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/mri/field_table.hpp"
#include "algorithms/mri/frames.hpp"
#include "casefile/volumes/scan_fields_file.hpp"
#include "clients/cli/mri/control_points.hpp"
#include "clients/cli/mri/field_of_scans.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using geometry::Points3;
using nlohmann::json;

constexpr double kGrid_mm = 4.0;
constexpr double kMargin_mm = 24.0;
constexpr int kThreads = 2;

struct FieldArguments {
  std::string ct, output, scanner, protocol;
  std::vector<std::string> mr; // one scan, or several that separate gradients and B0
  ScanProtocols scans;
  std::string patient_position = "HFS";
  bool any_orientation = false;
  int days = 90;
};

std::string date(int days_from_now) {
  const std::time_t at =
      std::chrono::system_clock::to_time_t(std::chrono::system_clock::now() + std::chrono::hours(24 * days_from_now));
  std::tm utc{};
  gmtime_r(&at, &utc);
  char text[16];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%d", &utc)};
}

// The fields as tables, to the output file.
base::Result<void> write_fields(const FieldArguments &arguments, const mri::ScanFields &fields, std::string &text,
                                json &out) {
  casefile::FieldHeader header;
  header.scanner = arguments.scanner;
  header.protocol = arguments.protocol;
  header.patient_position = arguments.patient_position;
  header.made = date(0);
  header.expires = arguments.days > 0 ? date(arguments.days) : "";
  if (auto written = casefile::write_scan_fields(arguments.output, fields, header); !written) {
    return written;
  }
  const std::string b0 = fields.has_b0() ? casefile::b0_file_of(arguments.output).string() : "";
  text += (b0.empty() ? "" : "The part of the gradients, the same for every protocol, and that of B0: ") +
          ("Written: " + arguments.output) + (b0.empty() ? "" : ", " + b0) + " and " +
          (b0.empty() ? casefile::error_file_of(arguments.output).string() : "their errors") +
          "; the grid differs from the field by at most " + fixed(fields.table()->table_error_mm(), 3, "mm") + "\n";
  out["output"] = arguments.output;
  if (!b0.empty()) {
    out["output_b0"] = b0;
  }
  out["grid_error_mm"] = json_number(fields.table()->table_error_mm());
  return {};
}

// Writes the fields, where a file is asked for, and prints what was found.
template <class MakeFields>
int finish(const FieldArguments &arguments, const MakeFields &make, std::string text, json out,
           const Context &context) {
  if (!arguments.output.empty()) {
    if (auto written = write_fields(arguments, make(), text, out); !written) {
      return fail(written.error());
    }
  }
  if (context.json) {
    out["accepted"] = true;
    print_json(out);
  } else {
    print(text);
  }
  return kOk;
}

int run_several(const FieldArguments &arguments, const Points3 &ct, const std::vector<Points3> &scans,
                const Context &context) {
  mri::MatchOptions options;
  options.same_orientation = !arguments.any_orientation;
  const auto found = field_of_scans(ct, scans, arguments.mr, arguments.scans, options);
  if (!found) {
    json nothing;
    withhold(nothing, {"output"});
    return refuse("refused", found.error().message, context, std::move(nothing));
  }
  const auto fields = [&] { return mri::ScanFields(found->field, found->mm_per_Hz, kGrid_mm, kMargin_mm, kThreads); };
  return finish(arguments, fields, found->text, found->figures, context);
}

int run_field(const FieldArguments &arguments, const Context &context) {
  std::vector<std::string> notes;
  const auto ct = read_control_points(arguments.ct, notes);
  if (!ct) {
    return fail(ct.error());
  }
  std::vector<Points3> scans;
  std::vector<std::string> inputs{arguments.ct};
  for (const std::string &file : arguments.mr) {
    auto points = read_control_points(file, notes);
    if (!points) {
      return fail(points.error());
    }
    scans.push_back(std::move(*points));
    inputs.push_back(file);
  }
  print_notes(notes);
  if (auto free = check_output("--output", arguments.output, inputs); !free) {
    return fail(free.error());
  }
  if (const auto lists = check_lists(*ct, scans, inputs); !lists) {
    json nothing;
    withhold(nothing, {"output"});
    return refuse("refused", lists.error().message, context, std::move(nothing));
  }
  if (scans.size() > 1) {
    return run_several(arguments, *ct, scans, context);
  }
  Eigen::Vector3d mm_per_Hz = Eigen::Vector3d::Zero(); // not stated
  if (!arguments.scans.read_outs.empty()) {
    if (const std::string missing = missing_in(arguments.scans, 1); !missing.empty()) {
      return fail(missing);
    }
    const auto stated = scan_movement(arguments.scans, 0);
    if (!stated) {
      return fail(stated.error());
    }
    mm_per_Hz = *stated;
  }
  const Points3 *mr = &scans.front();
  mri::MatchOptions options;
  options.same_orientation = !arguments.any_orientation;
  const mri::MatchResult match = mri::match_points(*ct, *mr, options);
  json out = {{"match", match_json(match)}};
  std::string text = match_text(match, ct->cols(), mr->cols());
  if (match.outcome != mri::MatchOutcome::kMatched) {
    withhold(out, {"output", "initial", "residual"});
    if (!context.json) {
      print(text);
    }
    return refuse(mri::name(match.outcome), why_not_matched(match, *ct, *mr), context, std::move(out));
  }
  const Points3 truth = match.reference_points(*ct), imaged = match.imaged_points(*mr);
  const auto field = mri::DistortionField::fit(truth, imaged);
  if (!field) {
    return fail(field.error());
  }
  const auto after = mri::hold_out(truth, imaged);
  if (!after) {
    return fail(after.error());
  }
  const mri::ErrorSummary before = mri::summarise(imaged - truth);
  text += "\nDistortion before and after correction; the residual is that of every other point, held out\n" +
          distortion_table(before, *after) + "Local spline: " + (field->has_spline() ? "used" : "not needed") + "\n";
  if (!(after->overall.mean_mm < before.overall.mean_mm)) {
    print_notes({arguments.mr.front() + ": at points held out the field is no better than none (" +
                 fixed(after->overall.mean_mm, 2, "mm") + " in place of " + fixed(before.overall.mean_mm, 2, "mm") +
                 "): the points' own errors are larger than the distortion"});
  }
  out["initial"] = summary_json(before);
  out["residual"] = summary_json(*after);
  out["local_spline"] = field->has_spline();
  const auto fields = [&] {
    return mri::ScanFields(std::make_shared<const mri::FieldTable>(*field, kGrid_mm, kMargin_mm, kThreads), mm_per_Hz);
  };
  return finish(arguments, fields, std::move(text), std::move(out), context);
}

} // namespace

void add_mri_field(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("field", "Finds a scanner's distortion field from a phantom's control points");
  auto arguments = std::make_shared<FieldArguments>();
  command->add_option("ct", arguments->ct, "Control points in CT (.mrk.json, .fcsv or a table)")->required();
  command
      ->add_option("mr", arguments->mr,
                   "Control points in MR; their origin is the isocentre. Several scans separate gradients and B0")
      ->required();
  auto *read_out = command
                       ->add_option("--read-out", arguments->scans.read_outs,
                                    "Once per scan: where its read-out shifts a spin of higher frequency to (R, L, A, "
                                    "P, S, I)")
                       ->check(CLI::IsMember({"R", "L", "A", "P", "S", "I"}))
                       ->expected(1)
                       ->take_all();
  command
      ->add_option("--slice-shift", arguments->scans.slices,
                   "The same along the normal of its slices; without it slices are not shifted")
      ->check(CLI::IsMember({"R", "L", "A", "P", "S", "I"}))
      ->expected(1)
      ->take_all()
      ->needs(read_out);
  command->add_option("--pixel-mm", arguments->scans.pixel_mm, "Pixel along the read-out")
      ->check(CLI::Range(0.05, 20.0))
      ->needs(read_out);
  command->add_option("--bandwidth-Hz", arguments->scans.bandwidth_Hz, "Bandwidth per pixel")
      ->check(CLI::Range(1.0, 100000.0))
      ->needs(read_out);
  command->add_option("--thickness-mm", arguments->scans.thickness_mm, "With --slice-shift: thickness of a slice")
      ->check(CLI::Range(0.05, 100.0));
  command->add_option("--pulse-Hz", arguments->scans.pulse_Hz, "With --slice-shift: bandwidth of the slice's pulse")
      ->check(CLI::Range(10.0, 100000.0));
  command->add_flag("--own-placement", arguments->scans.own_placement,
                    "Several scans: each may lie and step otherwise than the first, perpendicular to the read-outs");
  command->add_option("-o,--output", arguments->output, "Distortion field (.nrrd), read by ITK and Slicer");
  command->add_option("--scanner", arguments->scanner,
                      "Scanner, as its DICOM headers name it: the field is for no other");
  command->add_option("--protocol", arguments->protocol, "Protocol of the phantom's scan");
  command->add_option("--patient-position", arguments->patient_position, "Patient position of the phantom's scan")
      ->check([](const std::string &text) {
        const auto position = mri::parse_patient_position(text);
        return position ? std::string() : position.error();
      })
      ->capture_default_str();
  command->add_option("--days", arguments->days, "Days until the field expires; 0: never")
      ->check(CLI::Range(0, 3650))
      ->capture_default_str();
  command->add_flag("--any-orientation", arguments->any_orientation,
                    "The phantom may lie otherwise in MR than in CT: turned placements are tried");
  add_json_flag(*command, context);
  command->footer("The exit code is 1 where the correspondence is not certain.\n\nExamples:\n"
                  "  bregma mri field CT.mrk.json MR.mrk.json -o field.nrrd --scanner \"SIEMENS Vida 175614\"\n"
                  "  bregma mri field CT.mrk.json MR.mrk.json --json\n"
                  "  bregma mri field CT.mrk.json R.mrk.json L.mrk.json --read-out R --read-out L --pixel-mm 1 "
                  "--bandwidth-Hz 260");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_field(*arguments, context); }; });
}

} // namespace bregma::cli
