// `bregma export`: a recorded session as CSV files.
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "casefile/session_file/session_file.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/mri/scanner_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"

namespace bregma::cli {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
  std::vector<std::string> sessions;
  std::string folder;
};

std::string utc_text(std::int64_t time_ns) {
  const std::time_t seconds = static_cast<std::time_t>(time_ns / 1'000'000'000);
  std::tm parts{};
  char text[48];
  if (time_ns < 0 || gmtime_r(&seconds, &parts) == nullptr ||
      std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &parts) == 0) {
    return {};
  }
  char out[64];
  std::snprintf(out, sizeof out, "%s.%06lldZ", text, static_cast<long long>(time_ns % 1'000'000'000 / 1'000));
  return out;
}

// The text of a recorded message, whether or not it is terminated.
template <std::size_t kSize> std::string_view content(const char (&text)[kSize]) {
  return {text, strnlen(text, kSize)};
}

// One CSV file (RFC 4180, with \n): comma, decimal point, a header of names. An unknown number is an empty field.
class CsvFile {
public:
  CsvFile(fs::path path, std::string_view header) : path_(std::move(path)), out_(path_, std::ios::binary) {
    out_ << header << '\n';
  }
  CsvFile &time(std::int64_t time_ns) { return number(time_ns).text(utc_text(time_ns)); }
  CsvFile &number(std::int64_t value) { return raw(std::to_string(value)); }
  CsvFile &count(std::uint64_t value) { return raw(std::to_string(value)); }
  CsvFile &number(double value) {
    char text[40] = "";
    if (std::isfinite(value)) {
      std::snprintf(text, sizeof text, "%.9g", value); // 10 nm at 1 m
    }
    return raw(text);
  }
  CsvFile &numbers(std::span<const double> values) {
    for (const double value : values) {
      number(value);
    }
    return *this;
  }
  CsvFile &text(std::string_view value) {
    if (value.find_first_of(",\"\r\n") == std::string_view::npos) {
      return raw(value);
    }
    std::string quoted = "\"";
    for (const char c : value) {
      quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
    }
    return raw(quoted + "\"");
  }
  void end_row() {
    out_ << '\n';
    first_ = true;
    ++rows_;
  }
  // The number of rows.
  [[nodiscard]] base::Result<std::size_t> close() {
    out_.close();
    return out_ ? base::Result<std::size_t>(rows_)
                : base::failure(path_.string() + ": cannot be written: is the disk full?");
  }
  [[nodiscard]] const fs::path &path() const { return path_; }

private:
  CsvFile &raw(std::string_view field) {
    out_ << (first_ ? "" : ",") << field;
    first_ = false;
    return *this;
  }

  fs::path path_;
  std::ofstream out_;
  bool first_ = true;
  std::size_t rows_ = 0;
};

using Written = base::Result<std::size_t>;

Written write_poses(const casefile::SessionReader &reader, const fs::path &file) {
  CsvFile csv(file, "time_ns,utc,tool,frame,status,age_ms,r_mm,a_mm,s_mm,qw,qx,qy,qz,tre_rms_mm,tre_95_mm,trajectory,"
                    "distance_to_target_mm,distance_to_predicted_target_mm,lateral_deviation_mm,angle_rad,"
                    "remaining_depth_mm,nearest_structure,nearest_structure_mm,nearest_structure_sigma_mm");
  return reader
      .each<wire::NavigationState>([&](const wire::NavigationState &state, std::int64_t) {
        csv.time(state.published_time_ns).text(wire::view(state.tool)).count(state.frame);
        csv.text(pose_label(state.status));
        csv.number(state.acquired_time_ns > 0 ? static_cast<double>(state.age_ns) * 1e-6 : wire::kUnknown);
        csv.numbers(state.T_image_tip.translation_mm).numbers(state.T_image_tip.rotation_wxyz);
        csv.number(state.tre_rms_mm).number(state.tre_95.semi_axes_mm[0]).text(wire::view(state.trajectory));
        csv.number(state.distance_to_target_mm).number(state.distance_to_predicted_target_mm);
        csv.number(state.lateral_deviation_mm).number(state.angle_rad).number(state.remaining_depth_mm);
        csv.text(wire::view(state.nearest_structure)).number(state.nearest_structure_mm);
        csv.number(state.nearest_structure_sigma_mm).end_row();
      })
      .and_then([&](std::size_t) { return csv.close(); });
}

Written write_robot_tools(const casefile::SessionReader &reader, const fs::path &file) {
  CsvFile csv(file, "time_ns,utc,arm,tool,frame,status,age_ms,base_x_mm,base_y_mm,base_z_mm,base_qw,base_qx,base_qy,"
                    "base_qz,scanner_status,scanner,x_mm,y_mm,z_mm,qw,qx,qy,qz,error_95_mm");
  return reader
      .each<wire::RobotTool>([&](const wire::RobotTool &tool, std::int64_t) {
        csv.time(tool.published_time_ns).text(wire::view(tool.device)).text(wire::view(tool.tool)).count(tool.frame);
        csv.text(pose_label(tool.status));
        csv.number(tool.acquired_time_ns > 0 ? static_cast<double>(tool.age_ns) * 1e-6 : wire::kUnknown);
        csv.numbers(tool.T_base_tip.translation_mm).numbers(tool.T_base_tip.rotation_wxyz);
        csv.text(pose_label(tool.scanner_status)).text(wire::view(tool.scanner));
        csv.numbers(tool.T_scanner_tip.translation_mm).numbers(tool.T_scanner_tip.rotation_wxyz);
        csv.number(tool.scanner_error_95_mm).end_row();
      })
      .and_then([&](std::size_t) { return csv.close(); });
}

// Changes only: the topics repeat their states.
Written write_states(const casefile::SessionReader &reader, const fs::path &file) {
  CsvFile csv(file, "time_ns,utc,of,state,fiducials,surface_points,fre_mm,text");
  std::string session;
  std::string registration;
  std::string scanner;
  return reader
      .each<wire::SystemHealth>([&](const wire::SystemHealth &health, std::int64_t time_ns) {
        if (const std::string state(session_label(health.session)); state != session) {
          session = state;
          csv.time(time_ns).text("session").text(state).text("").text("").text("").text("").end_row();
        }
      })
      .and_then([&](std::size_t) {
        return reader.each<wire::RegistrationState>([&](const wire::RegistrationState &state, std::int64_t time_ns) {
          const std::string label(registration_label(state.status));
          const std::string key =
              label + std::to_string(state.revision) + "/" + std::to_string(state.accepted_revision);
          if (key != registration) {
            registration = key;
            csv.time(time_ns).text("registration").text(label).count(state.fiducial_count).count(state.surface_count);
            csv.number(state.fre_mm).text(content(state.text)).end_row();
          }
        });
      })
      .and_then([&](std::size_t) {
        return reader.each<wire::ScannerRegistration>([&](const wire::ScannerRegistration &state,
                                                          std::int64_t time_ns) {
          std::string label =
              std::string(scanner_step_label(state.step)) + ": " + std::string(scanner_activity_label(state.activity));
          if (state.validity > bregma_wire_SCANNER_VALIDITY_NONE) {
            label += ", registration " + std::string(scanner_validity_label(state.validity));
          }
          if (const std::string key = label + std::to_string(state.revision); key != scanner) {
            scanner = key;
            csv.time(time_ns).text("scanner").text(label).text("").text("").number(state.fre_mm);
            csv.text(content(state.text)).end_row();
          }
        });
      })
      .and_then([&](std::size_t) { return csv.close(); });
}

std::string_view capture_label(wire::CaptureKind kind) {
  switch (kind) {
  case bregma_wire_CAPTURE_FIDUCIAL_TOUCH:
    return "fiducial";
  case bregma_wire_CAPTURE_SURFACE:
    return "surface";
  case bregma_wire_CAPTURE_CHECK:
    return "check";
  default:
    return kNotKnownHere;
  }
}

Written write_events(const casefile::SessionReader &reader, const fs::path &file) {
  CsvFile csv(file, "time_ns,utc,event,kind,subject,state,severity,x_mm,y_mm,z_mm,text");
  return reader
      .each<wire::CommandReply>([&](const wire::CommandReply &reply, std::int64_t time_ns) {
        csv.time(time_ns).text("command").text(wire::command_name(reply.kind)).text(wire::view(reply.client));
        csv.text(result_label(reply.result)).text("").text("").text("").text("").text(content(reply.text)).end_row();
      })
      .and_then([&](std::size_t) {
        return reader.each<wire::Alarm>([&](const wire::Alarm &alarm, std::int64_t time_ns) {
          csv.time(time_ns).text("alarm").text(wire::view(alarm.kind)).text(wire::view(alarm.subject));
          csv.text(alarm_label(alarm.state)).text(severity_label(alarm.severity)).text("").text("").text("");
          csv.text(content(alarm.text)).end_row();
        });
      })
      .and_then([&](std::size_t) {
        return reader.each<wire::CapturedPoint>([&](const wire::CapturedPoint &point, std::int64_t time_ns) {
          if (point.ended) {
            return;
          }
          csv.time(time_ns)
              .text("point")
              .text(capture_label(point.kind))
              .text(wire::view(point.tool))
              .text("")
              .text("");
          csv.numbers(point.position_mm).text(wire::view(point.point)).end_row();
        });
      })
      .and_then([&](std::size_t) { return csv.close(); });
}

struct ExportFile {
  const char *name;
  Written (*write)(const casefile::SessionReader &, const fs::path &);
};
constexpr std::array<ExportFile, 4> kExportFiles{{{"poses.csv", write_poses},
                                                  {"states.csv", write_states},
                                                  {"events.csv", write_events},
                                                  {"robot_tools.csv", write_robot_tools}}};

int run_export(const ExportOptions &options, const Context &context) {
  const std::vector<fs::path> files(options.sessions.begin(), options.sessions.end());
  const auto reader = casefile::SessionReader::open(files);
  if (!reader) {
    return fail(reader.error());
  }
  const fs::path folder = options.folder;
  std::error_code code;
  fs::create_directories(folder, code);
  if (code) {
    return fail(folder.string() + ": cannot be made: " + code.message());
  }
  for (const ExportFile &file : kExportFiles) {
    if (fs::exists(folder / file.name, code)) {
      return fail((folder / file.name).string() + ": exists already; state another folder by --to");
    }
  }
  nlohmann::json rows = nlohmann::json::object();
  std::string text;
  for (const ExportFile &file : kExportFiles) {
    const Written written = file.write(*reader, folder / file.name);
    if (!written) {
      return fail(written.error());
    }
    rows[file.name] = *written;
    text += (folder / file.name).string() + ": " + std::to_string(*written) + " rows\n";
  }
  if (context.json) {
    print_json({{"folder", folder.string()}, {"rows", rows}});
  } else {
    print(text);
  }
  return kOk;
}

} // namespace

void add_export_command(CLI::App &app, Context &context) {
  auto options = std::make_shared<ExportOptions>();
  auto *command =
      app.add_subcommand("export", "Writes a recorded session as CSV: poses, states, events and tools of robots");
  command
      ->add_option("session", options->sessions,
                   "Session file (.db); all files of one operation if the daemon was restarted in it")
      ->required();
  command->add_option("--to", options->folder, "Folder for poses.csv, states.csv and events.csv; made if missing")
      ->required();
  add_json_flag(*command, context);
  command->footer("The columns are described in docs/cli.md. Existing files are never replaced.\n\nExamples:\n"
                  "  bregma export sessions/20240501T102000Z.db --to csv");
  command->callback(
      [options, &context] { context.run = [options, &context] { return run_export(*options, context); }; });
}

} // namespace bregma::cli
