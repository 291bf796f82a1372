#include "clients/cli/output.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "base/text.hpp"
#include "clients/cli/plain_text.hpp"

namespace bregma::cli {

namespace {

// Number of code points. A terminal shows one column per code point in the scripts used here.
std::size_t width(const std::string &text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

bool is_figure(const std::string &cell) {
  const std::size_t first = cell.find_first_not_of("+-");
  return cell == "-" || (first != std::string::npos && std::isdigit(static_cast<unsigned char>(cell[first])) != 0);
}

// A file in a folder of inputs, such as a DICOM series, or the voxels that lie beside a header of the same name.
bool is_part_of(const std::filesystem::path &output, const std::filesystem::path &input) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path out = fs::canonical(output, error); // a new file is no part of anything
  if (error) {
    return false;
  }
  const fs::path in = fs::canonical(input, error);
  if (error) {
    return false;
  }
  if (fs::is_directory(in, error)) {
    return std::mismatch(in.begin(), in.end(), out.begin(), out.end()).first == in.end();
  }
  constexpr std::array<std::string_view, 6> kVoxels{".raw", ".zraw", ".img", ".hdr", ".gz", ".bin"};
  const std::string extension = base::lower(out.extension().string());
  return out.parent_path() == in.parent_path() && out.filename().stem() == in.filename().stem() &&
         std::find(kVoxels.begin(), kVoxels.end(), extension) != kVoxels.end();
}

} // namespace

std::string Table::text() const {
  std::vector<std::size_t> widths;
  std::vector<bool> right;
  for (std::size_t column = 0; column < header_.size(); ++column) {
    std::size_t widest = width(header_[column]);
    bool figures = !rows_.empty();
    for (const auto &row : rows_) {
      if (column < row.size()) {
        widest = std::max(widest, width(row[column]));
        figures = figures && (row[column].empty() || is_figure(row[column]));
      }
    }
    widths.push_back(widest);
    right.push_back(figures);
  }
  std::string out;
  const auto print_row = [&](const std::vector<std::string> &cells) {
    std::string line;
    for (std::size_t column = 0; column < std::min(cells.size(), widths.size()); ++column) {
      const std::string padding(widths[column] - width(cells[column]), ' ');
      line += (column == 0 ? "" : "  ") + (right[column] ? padding + cells[column] : cells[column] + padding);
    }
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + "\n";
  };
  print_row(header_);
  for (const auto &row : rows_) {
    print_row(row);
  }
  return out;
}

std::string fixed(double value, int decimals, std::string_view unit) {
  if (!std::isfinite(value)) {
    return "-";
  }
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.*f", decimals, value);
  std::string out = buffer;
  // Print -0.000 as zero.
  if (out.front() == '-' && out.find_first_not_of("-0.") == std::string::npos) {
    out.erase(0, 1);
  }
  return unit.empty() ? out : out + " " + std::string(unit);
}

std::string known(double value, int decimals, std::string_view unit) {
  return std::isfinite(value) ? fixed(value, decimals, unit) : "not known";
}

std::string vector_text(const Eigen::Vector3d &v, int decimals) {
  return "(" + fixed(v.x(), decimals) + ", " + fixed(v.y(), decimals) + ", " + fixed(v.z(), decimals) + ")";
}

nlohmann::json json_number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::json json_vector(const Eigen::Vector3d &v) {
  return {json_number(v.x()), json_number(v.y()), json_number(v.z())};
}

nlohmann::json json_matrix(const Eigen::MatrixXd &m) {
  auto rows = nlohmann::json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    auto row = nlohmann::json::array();
    for (Eigen::Index j = 0; j < m.cols(); ++j) {
      row.push_back(json_number(m(i, j)));
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

void print(std::string_view text) { std::fwrite(text.data(), 1, text.size(), stdout); }

std::string json_text(const nlohmann::json &json, int indent) {
  // Names come from files and from DDS, and may not be valid UTF-8.
  const std::string text = json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = [&](std::size_t at) { return at < text.size() ? static_cast<unsigned char>(text[at]) : 0U; };
    char escaped[8];
    if (byte(i) == 0x7FU) {
      out += "\\u007f";
    } else if (byte(i) == 0xC2U && byte(i + 1) >= 0x80U && byte(i + 1) < 0xA0U) { // C1 control characters
      std::snprintf(escaped, sizeof escaped, "\\u%04x", byte(++i));
      out += escaped;
    } else {
      out += text[i];
    }
  }
  return out;
}

void print_json(const nlohmann::json &json) { print(json_text(json, 2) + "\n"); }

void print_notes(const std::vector<std::string> &notes) {
  std::fflush(stdout);
  for (const std::string &note : notes) {
    const std::string line = "note: " + printable(note) + "\n";
    std::fwrite(line.data(), 1, line.size(), stderr);
  }
}

base::Result<void> check_output(std::string_view option, const std::string &output,
                                const std::vector<std::string> &inputs) {
  for (const std::string &input : inputs) {
    if (output.empty() || input.empty()) {
      continue;
    }
    std::error_code no_such_file; // then it is not the same
    if (std::filesystem::equivalent(output, input, no_such_file)) {
      return base::failure(std::string(option) + " " + output + " is an input file: it is not written over");
    }
    if (is_part_of(output, input)) {
      return base::failure(std::string(option) + " " + output + " is a part of the input " + input +
                           ": it is not written over");
    }
  }
  return {};
}

int fail(std::string_view message) {
  std::fflush(stdout);
  const std::string line = "bregma: " + printable(message) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
  return kBadInput;
}

int fail(const base::Error &error) { return fail(error.message); }

void withhold(nlohmann::json &document, std::initializer_list<const char *> keys) {
  for (const char *key : keys) {
    document[key] = nullptr;
  }
}

int refuse(const std::string &verdict, const std::string &reason, const Context &context, nlohmann::json extra) {
  if (context.json) {
    extra["accepted"] = false;
    extra["verdict"] = verdict;
    extra["reason"] = reason;
    print_json(extra);
  } else {
    static_cast<void>(fail(verdict + ": " + reason));
  }
  return kRefused;
}

} // namespace bregma::cli
