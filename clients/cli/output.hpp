// Output of commands: tables and JSON to standard output, one sentence to standard error.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "base/result.hpp"
#include "clients/cli/commands.hpp"

namespace bregma::cli {

// Columns as wide as their widest cell; numbers are right-aligned. UTF-8 aware. No trailing blanks.
class Table {
public:
  explicit Table(std::vector<std::string> header) : header_(std::move(header)) {}
  void row(std::vector<std::string> cells) { rows_.push_back(std::move(cells)); }
  [[nodiscard]] bool empty() const { return rows_.empty(); }
  [[nodiscard]] std::string text() const;

private:
  std::vector<std::string> header_;
  std::vector<std::vector<std::string>> rows_;
};

// "-" for an unknown value (not finite).
[[nodiscard]] std::string fixed(double value, int decimals, std::string_view unit = {});
// The same in a sentence: "not known" for an unknown value.
[[nodiscard]] std::string known(double value, int decimals, std::string_view unit);
[[nodiscard]] std::string vector_text(const Eigen::Vector3d &v, int decimals); // "(1.0, 2.0, 3.0)"

// JSON has no NaN: an unknown value is null.
[[nodiscard]] nlohmann::json json_number(double value);
[[nodiscard]] nlohmann::json json_vector(const Eigen::Vector3d &v);
[[nodiscard]] nlohmann::json json_matrix(const Eigen::MatrixXd &m); // array of rows

// Valid UTF-8 without control characters except the newlines of the indentation: every reader and terminal can take it.
[[nodiscard]] std::string json_text(const nlohmann::json &json, int indent = -1);

void print(std::string_view text);           // as it is
void print_json(const nlohmann::json &json); // indented, with a newline
// "note: <sentence>" on standard error, each: what a reader assumed or left out.
void print_notes(const std::vector<std::string> &notes);
// Refuses an output that is an input, lies in a folder of inputs or holds an input's voxels. Empty paths are ignored.
[[nodiscard]] base::Result<void> check_output(std::string_view option, const std::string &output,
                                              const std::vector<std::string> &inputs);
// "bregma: <message>" on standard error, and kBadInput.
int fail(const base::Error &error);
int fail(std::string_view message);
// Of a refused result nothing may be used: these keys become null, whatever was estimated.
void withhold(nlohmann::json &document, std::initializer_list<const char *> keys);
// Prints the sentence to standard error (in JSON: verdict and reason, plus `extra`) and returns kRefused. extra holds
// nothing that could be used (withhold).
int refuse(const std::string &verdict, const std::string &reason, const Context &context,
           nlohmann::json extra = nlohmann::json::object());

} // namespace bregma::cli
