// `bregma mri correct`: an image corrected by a distortion field.
#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/mri/correction.hpp"
#include "algorithms/mri/frames.hpp"
#include "casefile/volumes/scan_fields_file.hpp"
#include "casefile/volumes/scan_header.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/mri/field_use.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/mri/read_out.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using nlohmann::json;

struct CorrectArguments {
  std::string field, image, output, series, patient_position;
  std::string read_out; // empty: not stated
  double bandwidth_Hz = 0.0;
  bool not_corrected = false, other_scanner = false, expired = false, jacobian = false;
};

// The image as slices: its shortest axis counts them. Values in the order of `order`.
struct SlicesOfVolume {
  std::array<int, 3> order{0, 1, 2}; // axes of the volume that are columns, rows and slices
  std::vector<std::vector<float>> values;
};
SlicesOfVolume slices_of_volume(const casefile::Volume &volume) {
  SlicesOfVolume out;
  const auto through = static_cast<int>(std::min_element(volume.size.begin(), volume.size.end()) - volume.size.begin());
  out.order = {(through + 1) % 3, (through + 2) % 3, through};
  const auto size = [&](int d) {
    return volume.size[static_cast<std::size_t>(out.order[static_cast<std::size_t>(d)])];
  };
  std::array<int, 3> at{};
  const auto index = [&](int d) -> int & {
    return at[static_cast<std::size_t>(out.order[static_cast<std::size_t>(d)])];
  };
  for (index(2) = 0; index(2) < size(2); ++index(2)) {
    auto &slice = out.values.emplace_back();
    for (index(1) = 0; index(1) < size(1); ++index(1)) {
      for (index(0) = 0; index(0) < size(0); ++index(0)) {
        slice.push_back(volume.at(at[0], at[1], at[2]));
      }
    }
  }
  return out;
}

void put_back(const SlicesOfVolume &slices, casefile::Volume &volume) {
  std::array<int, 3> at{};
  const auto index = [&](int d) -> int & {
    return at[static_cast<std::size_t>(slices.order[static_cast<std::size_t>(d)])];
  };
  for (index(2) = 0; index(2) < static_cast<int>(slices.values.size()); ++index(2)) {
    const auto &slice = slices.values[static_cast<std::size_t>(index(2))];
    std::size_t n = 0;
    const int rows = volume.size[static_cast<std::size_t>(slices.order[1])];
    const int columns = volume.size[static_cast<std::size_t>(slices.order[0])];
    for (index(1) = 0; index(1) < rows; ++index(1)) {
      for (index(0) = 0; index(0) < columns; ++index(0), ++n) {
        volume.voxels[volume.offset(at[0], at[1], at[2])] = slice[n];
      }
    }
  }
}

struct Summary {
  mri::CorrectionSummary worst; // over all slices; fractions are means
  double missing_fraction = 0.0;
};

// T_field_image: from the image's RAS frame into that of the field.
Summary correct(casefile::Volume &volume, const mri::FieldTable &table, const Eigen::Matrix4d &T_field_image,
                bool jacobian) {
  const SlicesOfVolume slices = slices_of_volume(volume);
  std::vector<std::span<const float>> views(slices.values.begin(), slices.values.end());
  SlicesOfVolume corrected = slices;
  const int count = static_cast<int>(views.size());
  mri::PlaneGeometry plane;
  plane.columns = volume.size[static_cast<std::size_t>(slices.order[0])];
  plane.rows = volume.size[static_cast<std::size_t>(slices.order[1])];
  Summary out;
  for (int k = 0; k < count; ++k) {
    Eigen::Matrix4d T_image_plane = volume.T_image_index;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      T_image_plane.col(axis) = volume.T_image_index.col(slices.order[static_cast<std::size_t>(axis)]);
    }
    T_image_plane.col(3) += k * T_image_plane.col(2);
    plane.T_field_index = T_field_image * T_image_plane;
    const mri::PlaneCorrection correction(table, plane, jacobian);
    correction.apply<float>(views, k, corrected.values[static_cast<std::size_t>(k)]);
    const mri::CorrectionSummary &s = correction.summary();
    out.worst.max_shift_mm = std::max(out.worst.max_shift_mm, s.max_shift_mm);
    out.worst.max_through_plane_mm = std::max(out.worst.max_through_plane_mm, s.max_through_plane_mm);
    out.worst.error_95_mm = std::max(out.worst.error_95_mm, s.error_95_mm);
    out.worst.extrapolated_fraction += s.extrapolated_fraction / count;
    out.worst.unknown_fraction += s.unknown_fraction / count;
    out.missing_fraction += correction.missing_fraction(count, k) / count;
  }
  put_back(corrected, volume);
  return out;
}

base::Result<Eigen::Matrix4d> field_from_image(const std::string &field_position, const std::string &image_position) {
  const auto field = mri::parse_patient_position(field_position);
  const auto image = mri::parse_patient_position(image_position);
  if (!field || !image) {
    return base::failure(!field ? field.error() : image.error());
  }
  const auto T_ras_lps = mri::T_image_patient();
  return (T_ras_lps * mri::T_device_patient(*field).inverse() * mri::T_device_patient(*image) * T_ras_lps.inverse())
      .matrix();
}

// What the image states, else the option, else that of the field. A position that is none is refused by its place.
base::Result<std::string> position_of(const CorrectArguments &arguments, const std::string &stated,
                                      const std::string &of_field, std::vector<std::string> &notes) {
  const std::string &option = arguments.patient_position;
  if (!stated.empty() && !option.empty() && stated != option) {
    return base::failure(arguments.image + ": states the patient position " + stated + ", --patient-position " +
                         option);
  }
  if (!stated.empty()) {
    const auto known = mri::parse_patient_position(stated);
    return known ? base::Result<std::string>(stated) : base::failure(arguments.image + ": " + known.error());
  }
  if (option.empty()) {
    notes.push_back(arguments.image + ": does not state its patient position: " + of_field +
                    ", that of the field, is assumed; otherwise say --patient-position");
  }
  return option.empty() ? of_field : option;
}

// The field of the image's own read-out, where both are known. A field of one read-out is not applied to the opposite
// one, where its part of B0 would be doubled.
base::Result<std::shared_ptr<const mri::FieldTable>> table_for(const CorrectArguments &arguments,
                                                               const mri::ScanFields &fields,
                                                               const image::Image<float, 3> &volume,
                                                               const Eigen::Matrix4d &T_field_image) {
  const auto note = [&](const std::optional<Eigen::Vector3d> &mm_per_Hz) {
    if (const std::string text = b0_note(fields, mm_per_Hz, "--read-out"); !text.empty()) {
      print_notes({arguments.field + ": " + text});
    }
  };
  if (arguments.read_out.empty()) {
    note(std::nullopt);
    return fields.table();
  }
  std::optional<casefile::ScanHeader> header;
  if (casefile::is_dicom(arguments.image)) {
    if (auto read = casefile::read_scan_header(arguments.image, arguments.series)) {
      header = std::move(*read);
    }
  }
  const auto in_image = movement_in(volume.T_image_index, arguments.read_out, arguments.bandwidth_Hz, header);
  if (!in_image) {
    return base::failure(arguments.image + ": " + in_image.error().message);
  }
  const Eigen::Vector3d mm_per_Hz = T_field_image.topLeftCorner<3, 3>() * *in_image;
  if (fields.is_opposite(mm_per_Hz)) {
    return base::failure(arguments.field + ": was measured with the opposite read-out, so B0 would be doubled; measure "
                                           "the phantom with both read-outs");
  }
  note(mm_per_Hz);
  return fields.of_scan(mm_per_Hz);
}

int refuse_correction(const std::string &reason, const Context &context) {
  nlohmann::json nothing;
  withhold(nothing, {"output"});
  return refuse("refused", reason, context, std::move(nothing));
}

int run_correct(const CorrectArguments &arguments, const Context &context) {
  const auto field = casefile::read_scan_fields(arguments.field);
  if (!field) {
    return fail(field.error());
  }
  std::vector<std::string> inputs{arguments.image};
  for (const std::filesystem::path &file : casefile::scan_field_files(arguments.field)) {
    inputs.push_back(file.string());
  }
  if (auto free = check_output("--output", arguments.output, inputs); !free) {
    return fail(free.error());
  }
  const FieldConsent consent{arguments.not_corrected, arguments.other_scanner, arguments.expired};
  if (auto valid = check_date(arguments.field, field->header, consent); !valid) {
    return refuse_correction(valid.error().message, context);
  }
  std::error_code ignored;
  if (!std::filesystem::exists(arguments.image, ignored)) {
    return fail(arguments.image + ": no such file or folder");
  }
  if (casefile::is_dicom(arguments.image)) {
    if (const auto header = casefile::read_scan_header(arguments.image, arguments.series); !header) {
      return fail(header.error());
    }
  }
  const auto stated = check_field_use(arguments.field, field->header, arguments.image, arguments.series, consent);
  if (!stated) {
    return refuse_correction(stated.error().message, context);
  }
  std::vector<std::string> notes;
  const auto position = position_of(arguments, *stated, field->header.patient_position, notes);
  if (!position) {
    return fail(position.error());
  }
  const auto T_field_image = field_from_image(field->header.patient_position, *position);
  if (!T_field_image) {
    return fail(T_field_image.error());
  }
  casefile::VolumeOptions options;
  options.series = arguments.series;
  auto volume = casefile::read_volume(arguments.image, options, &notes);
  print_notes(notes);
  if (!volume) {
    return fail(volume.error());
  }
  auto sizes = volume->size;
  std::sort(sizes.begin(), sizes.end());
  if (sizes[1] < 2) {
    return fail(arguments.image + ": a line of voxels is not an image");
  }
  const auto table = table_for(arguments, field->fields, *volume, *T_field_image);
  if (!table) {
    return fail(table.error());
  }
  const Summary s = correct(*volume, **table, *T_field_image, arguments.jacobian);
  if (s.worst.unknown_fraction >= 1.0) {
    return refuse_correction(arguments.image + ": lies outside the field everywhere", context);
  }
  if (auto written = casefile::write_volume(arguments.output, *volume); !written) {
    return fail(written.error());
  }
  if (context.json) {
    print_json({{"accepted", true},
                {"output", arguments.output},
                {"max_shift_mm", json_number(s.worst.max_shift_mm)},
                {"max_through_plane_mm", json_number(s.worst.max_through_plane_mm)},
                {"error_95_mm", json_number(s.worst.error_95_mm)},
                {"extrapolated_fraction", json_number(s.worst.extrapolated_fraction)},
                {"unknown_fraction", json_number(s.worst.unknown_fraction)},
                {"missing_fraction", json_number(s.missing_fraction)}});
  } else {
    print("Corrected by up to " + fixed(s.worst.max_shift_mm, 2, "mm") + ", " +
          fixed(s.worst.max_through_plane_mm, 2, "mm") + " through the slices; error at most " +
          fixed(s.worst.error_95_mm, 2, "mm") +
          " (95 %)\nVoxels outside the phantom's volume: " + fixed(100.0 * s.worst.extrapolated_fraction, 1) +
          " % extrapolated, " + fixed(100.0 * s.worst.unknown_fraction, 1) +
          " % unknown; beyond the outermost slice: " + fixed(100.0 * s.missing_fraction, 1) +
          " %\nWritten: " + arguments.output + "\n");
  }
  return kOk;
}

} // namespace

void add_mri_correct(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("correct", "Corrects an image by a distortion field");
  auto arguments = std::make_shared<CorrectArguments>();
  command->add_option("field", arguments->field, "Distortion field (.nrrd) from `bregma mri field`")->required();
  command->add_option("image", arguments->image, "Folder with a DICOM series, or NIfTI, NRRD, MetaImage")->required();
  command->add_option("-o,--output", arguments->output, "Corrected image (.nrrd, .nii, .nii.gz, .mha)")->required();
  command->add_option("--series", arguments->series, "UID of the series, where a folder holds several");
  command
      ->add_option("--patient-position", arguments->patient_position,
                   "Patient position of the image, where it does not state one")
      ->check([](const std::string &text) {
        const auto position = mri::parse_patient_position(text);
        return position ? std::string() : position.error();
      });
  auto *read_out =
      command
          ->add_option("--read-out", arguments->read_out,
                       "Where the image's read-out shifts a spin of higher frequency to (R, L, A, P, S, I): its B0 is "
                       "corrected where the field holds both parts")
          ->check(CLI::IsMember({"R", "L", "A", "P", "S", "I"}));
  command
      ->add_option("--bandwidth-Hz", arguments->bandwidth_Hz,
                   "With --read-out: bandwidth per pixel, where the image does not state it")
      ->check(CLI::Range(1.0, 100000.0))
      ->needs(read_out);
  command->add_flag("--jacobian", arguments->jacobian, "Correct the brightness as well");
  command->add_flag("--not-corrected", arguments->not_corrected,
                    "States that the vendor has not corrected the image, where its file cannot say so");
  command->add_flag("--other-scanner", arguments->other_scanner, "Accept a field of another scanner");
  command->add_flag("--expired", arguments->expired, "Accept a field that has expired");
  add_json_flag(*command, context);
  command->footer("Refused (exit code 1): images that the vendor has corrected, of another modality or scanner, and a "
                  "field that has expired.\n\nExamples:\n"
                  "  bregma mri correct field.nrrd series/ -o corrected.nrrd\n"
                  "  bregma mri correct field.nrrd image.nii.gz -o corrected.nii.gz --not-corrected --jacobian\n"
                  "  bregma mri correct field.nrrd series/ -o corrected.nrrd --read-out L");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_correct(*arguments, context); }; });
}

} // namespace bregma::cli
