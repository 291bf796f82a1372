#include "clients/cli/support_bundle.hpp"

#include <algorithm>
#include <array>
#include <ctime>
#include <fstream>
#include <iterator>
#include <memory>
#include <regex>
#include <sstream>
#include <system_error>
#include <thread>

#include <archive.h>
#include <archive_entry.h>
#include <nlohmann/json.hpp>
#include <sys/utsname.h>

#include "base/text.hpp"
#include "base/write_file.hpp"
#include "clients/cli/health_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"
#include "idl/version.hpp"

namespace bregma::cli {
namespace {

namespace fs = std::filesystem;

struct FreeArchive {
  void operator()(archive *writer) const { archive_write_free(writer); }
  void operator()(archive_entry *entry) const { archive_entry_free(entry); }
};

std::string replaced(std::size_t characters) { return "<text of " + std::to_string(characters) + " characters>"; }

// Keys of the configuration whose text is one of a list that the program knows.
constexpr std::array<std::string_view, 2> kChoices{"log.level", "deformation.material"};

bool is_number_or_flag(const std::string &value) {
  static const std::regex kPlain(R"(true|false|[-+]?(inf|nan|[0-9][0-9_.eE+-]*))");
  return std::regex_match(value, kPlain);
}

// Lines of the log that contain nothing but Bregma's own words, numbers and paths.
constexpr std::array<std::string_view, 11> kOwnLines{"bregmad ",
                                                     "SIGTERM: ending",
                                                     "SIGINT: ending",
                                                     "memory: ",
                                                     "network: ",
                                                     "no session to restore",
                                                     "the trace ends: ",
                                                     "tissue model of ",
                                                     "no tissue model: ",
                                                     "a command without a client's name was dropped",
                                                     "wire: no participant of another wire is left"};
// Lines of which only the beginning is kept.
constexpr std::array<std::string_view, 6> kBeginnings{"the last session is not restored",
                                                      "the last session waits for its case",
                                                      "the last session is given up",
                                                      "restored case ",
                                                      "wire: ",
                                                      "dds: "};

// The daemon's own lines are shorter. std::regex needs stack for every character.
constexpr std::size_t kMaxLine = 2000;

std::string own_words(const std::string &line) {
  std::smatch part;
  static const std::regex kAlarm(R"(alarm (raised|acknowledged|cleared): ([a-z_]+) .*)");
  if (std::regex_match(line, part, kAlarm)) {
    return "alarm " + part[1].str() + ": " + part[2].str();
  }
  // A client's name is not ours, and may contain anything.
  static const std::regex kCommand(R"(.* [0-9]+ ([A-Z][A-Z_]+): (refused: )?.*)");
  if (std::regex_match(line, part, kCommand)) {
    return "command " + part[1].str() + ": " + (part[2].matched ? "refused" : "done");
  }
  static const std::regex kLoop(R"((the [a-z_ ]+ loop does not advance|[a-z_ ]+ loop: .*))");
  const bool own = std::regex_match(line, kLoop) ||
                   std::any_of(kOwnLines.begin(), kOwnLines.end(), [&](auto known) { return line.starts_with(known); });
  if (own) {
    return without_paths(line);
  }
  for (const std::string_view beginning : kBeginnings) {
    if (line.starts_with(beginning)) {
      return std::string(beginning) + " " + replaced(line.size() - beginning.size());
    }
  }
  return replaced(line.size());
}

std::string first_line_of(const char *file, const std::string &key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with(key)) {
      const std::size_t at = line.find_first_of("=:");
      return std::string(base::trimmed(at == std::string::npos ? "" : std::string_view(line).substr(at + 1)));
    }
  }
  return "not known";
}

base::Result<void> write_parts(archive *writer, const fs::path &file, std::span<const BundlePart> parts) {
  const auto failure = [&] {
    const int code = archive_errno(writer);
    return base::failure(file.string() + ": cannot be written" + (code > 0 ? ": " + base::write_problem(code) : ""));
  };
  if (archive_write_add_filter_gzip(writer) != ARCHIVE_OK || archive_write_set_format_ustar(writer) != ARCHIVE_OK ||
      archive_write_open_filename(writer, file.c_str()) != ARCHIVE_OK) {
    return failure();
  }
  const std::time_t now = std::time(nullptr);
  for (const BundlePart &part : parts) {
    const std::unique_ptr<archive_entry, FreeArchive> entry(archive_entry_new());
    archive_entry_set_pathname(entry.get(), part.name.c_str());
    archive_entry_set_size(entry.get(), static_cast<la_int64_t>(part.content.size()));
    archive_entry_set_filetype(entry.get(), AE_IFREG);
    archive_entry_set_perm(entry.get(), 0644);
    archive_entry_set_mtime(entry.get(), now, 0);
    const bool good = archive_write_header(writer, entry.get()) == ARCHIVE_OK &&
                      archive_write_data(writer, part.content.data(), part.content.size()) ==
                          static_cast<la_ssize_t>(part.content.size());
    if (!good) {
      return failure();
    }
  }
  return archive_write_close(writer) == ARCHIVE_OK ? base::Result<void>() : failure();
}

} // namespace

base::Result<void> write_bundle(const fs::path &file, std::span<const BundlePart> parts) {
  std::error_code error;
  if (fs::exists(file, error)) {
    return base::failure(file.string() + ": exists already");
  }
  const fs::path fresh = file.string() + ".part";
  const std::unique_ptr<archive, FreeArchive> writer(archive_write_new());
  base::Result<void> written = write_parts(writer.get(), fresh, parts);
  if (written) {
    fs::rename(fresh, file, error);
    if (error) {
      written = base::failure(file.string() + ": cannot be written: " + error.message());
    }
  }
  if (!written) {
    std::error_code ignored;
    fs::remove(fresh, ignored);
  }
  return written;
}

std::string without_paths(const std::string &text) {
  static const std::regex kPath(R"((^|[\s"'(=:])/[^\s"',:;)]+)");
  return std::regex_replace(text, kPath, "$1<path>");
}

std::string anonymous_configuration(std::string_view toml) {
  static const std::regex kSection(R"(\s*\[([a-z_]+)\]\s*)");
  static const std::regex kLine(R"(\s*([A-Za-z0-9_]+)\s*=\s*(.*?)\s*)");
  std::istringstream in{std::string(toml)};
  std::string out;
  std::string section;
  for (std::string line; std::getline(in, line);) {
    std::smatch part;
    if (line.size() > kMaxLine) {
      continue;
    }
    if (std::regex_match(line, part, kSection)) {
      section = part[1].str() + ".";
      out += "[" + part[1].str() + "]\n";
      continue;
    }
    if (!std::regex_match(line, part, kLine)) {
      continue; // a comment or an empty line
    }
    const std::string key = part[1];
    std::string value = part[2];
    const bool text = value.starts_with('"') || value.starts_with('\'');
    if (!text) {
      value = value.substr(0, value.find('#'));
      value.erase(value.find_last_not_of(" \t") + 1);
    }
    const bool choice = std::find(kChoices.begin(), kChoices.end(), section + key) != kChoices.end();
    const bool plain_choice = choice && std::regex_match(value, std::regex("\"[a-z-]*\""));
    out +=
        key + " = " +
        (is_number_or_flag(value) || value == "\"\"" || plain_choice ? value : "\"" + replaced(value.size()) + "\"") +
        "\n";
  }
  return out;
}

std::string anonymous_log(std::string_view log) {
  static const std::regex kLine(R"((\d{4}-\d\d-\d\dT[0-9:.]+Z) ([a-z]+) (.*))");
  std::istringstream in{std::string(log)};
  std::string out;
  for (std::string line; std::getline(in, line);) {
    std::smatch part;
    const bool known = line.size() <= kMaxLine && std::regex_match(line, part, kLine);
    out += known ? part[1].str() + " " + part[2].str() + " " + own_words(part[3].str()) : replaced(line.size());
    out += "\n";
  }
  return out;
}

nlohmann::json anonymous_health(const wire::SystemHealth &health, const std::vector<wire::Alarm> &alarms) {
  nlohmann::json out{{"session", session_label(health.session)},
                     {"case_is_loaded", health.case_folder[0] != '\0'},
                     {"up_s", static_cast<double>(health.time_ns - health.started_time_ns) * 1e-9},
                     {"wire", wire::text_of({health.wire_generation, health.wire_revision})},
                     {"participants_of_another_wire", health.other_wire},
                     {"endpoints_that_do_not_match", health.mismatches[0] != '\0'},
                     {"ill_typed_samples", health.ill_typed_samples},
                     {"unknown_device_samples", health.unknown_device_samples},
                     {"refused_commands", health.refused_commands},
                     {"resident_bytes", health.resident_bytes},
                     {"recorded", health.recorded},
                     {"record_dropped", health.record_dropped},
                     {"recorder_failing", health.recorder_failing},
                     {"clock_error_ns", health.clock_error_ns},
                     {"clock_steps", health.clock_steps},
                     {"devices", nlohmann::json::array()},
                     {"loops", loops_json(health)},
                     {"alarms", nlohmann::json::array()}};
  for (const wire::DeviceHealth &device : devices(health)) {
    out["devices"].push_back(device_figures_json(device));
  }
  for (const wire::Alarm &alarm : alarms) {
    out["alarms"].push_back({{"kind", wire::text(alarm.kind)},
                             {"state", alarm_label(alarm.state)},
                             {"severity", severity_label(alarm.severity)},
                             {"count", alarm.count}});
  }
  return out;
}

std::string machine_text() {
  utsname system{};
  uname(&system);
  return "kernel        " + std::string(system.sysname) + " " + system.release + " " + system.machine +
         "\ndistribution  " + first_line_of("/etc/os-release", "PRETTY_NAME") + "\nprocessor     " +
         first_line_of("/proc/cpuinfo", "model name") + "\ncores         " +
         std::to_string(std::thread::hardware_concurrency()) + "\nmemory        " +
         first_line_of("/proc/meminfo", "MemTotal") + "\n";
}

} // namespace bregma::cli
