// Reads TOML files of a fixed layout (case.toml, scenarios) and checks them as it reads.
//
//   auto document = TomlDocument::read(path);
//   if (!document) ...
//   TableReader root = document->root();
//   scenario.rate_hz = root.number("rate_hz", 60.0, "Hz", 20, 1000);
//   for (TableReader &step : root.tables("steps")) { ... step.require_string("do") ...; step.finish(); }
//   if (auto ok = root.finish(); !ok) return tl::unexpected(ok.error());
//
// The first error is kept, and reading continues with the fallbacks, so that reading a file is straight code with one
// check at its end. Errors read "file:line: key = value: problem", like those of ParameterSet. Threads: one at a time.
// Readers must not outlive their document.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "base/parameters.hpp"
#include "base/result.hpp"

namespace toml {
inline namespace v3 {
class table;
class node;
} // namespace v3
} // namespace toml

namespace bregma::base {

// A key that a reader has asked for, whether the document has it or not.
struct KnownKey {
  std::string key; // from the root; "tools[].name" for a key of [[tools]]
  bool required = false;
  std::string rule;     // "0.01 to 20 mm", "text", "[x, y, z]"
  std::string fallback; // as in TOML; empty: required, or absent means something else than a value
  friend bool operator==(const KnownKey &, const KnownKey &) = default;
};

class TableReader {
public:
  struct Sink { // shared by all readers of a document
    std::string file;
    std::optional<Error> first_error;
    std::vector<KnownKey> known; // each once, in the order of reading
  };

  TableReader(const toml::table &table, std::shared_ptr<Sink> sink, std::string path = {});

  [[nodiscard]] bool has(std::string_view key) const;

  // A missing required key is an error; the value is then empty, or the lower end of the range.
  std::string require_string(std::string_view key);
  double require_number(std::string_view key, std::string_view unit, double min, double max);
  std::int64_t require_integer(std::string_view key, std::string_view unit, std::int64_t min, std::int64_t max);
  std::string require_choice(std::string_view key, const std::vector<std::string> &choices);
  Eigen::Vector3d require_vector3(std::string_view key); // three finite numbers

  std::string string(std::string_view key, std::string fallback);
  double number(std::string_view key, double fallback, std::string_view unit, double min, double max);
  std::optional<double> optional_number(std::string_view key, std::string_view unit, double min, double max);
  std::int64_t integer(std::string_view key, std::int64_t fallback, std::string_view unit, std::int64_t min,
                       std::int64_t max);
  bool flag(std::string_view key, bool fallback);
  std::string choice(std::string_view key, std::string fallback, const std::vector<std::string> &choices);
  Eigen::Vector3d vector3(std::string_view key, const Eigen::Vector3d &fallback);
  std::optional<Eigen::Vector3d> optional_vector3(std::string_view key);

  std::vector<Eigen::Vector3d> require_vector3s(std::string_view key); // may be an empty list
  // Exactly `count` finite numbers; zeros where they are missing or wrong.
  std::vector<double> require_numbers(std::string_view key, std::size_t count);
  // Empty where the key is absent.
  std::vector<Eigen::Vector3d> vector3s(std::string_view key);
  std::vector<std::string> strings(std::string_view key);
  std::vector<TableReader> tables(std::string_view key);  // [[key]]
  std::optional<TableReader> table(std::string_view key); // [key]

  // Reports a failed check of the caller: "file:line: key = value: what". key may be a path from this table,
  // "tools[2].name".
  // An absent key gives "file:line: key: what" with the line of the table.
  void refuse(std::string_view key, const std::string &what);

  // To be called when everything was read: refuses keys that were never read. Returns the first error of the document.
  Result<void> finish();

private:
  const toml::node *find(std::string_view key);
  const toml::node *require(std::string_view key);
  std::optional<ParameterValue> value(std::string_view key, const ValueRule &rule, bool required,
                                      const std::optional<ParameterValue> &fallback = std::nullopt);
  void note(std::string_view key, bool required, std::string rule, std::string fallback = {});
  std::optional<Eigen::Vector3d> vector_of(const toml::node &node, const std::string &key);
  void report(const toml::node &where, const std::string &key, const std::string &what, bool with_value);
  [[nodiscard]] std::string full(std::string_view key) const;

  const toml::table *table_;
  std::shared_ptr<Sink> sink_;
  std::string path_;                         // dotted path of this table: "" or "tools[2]"
  std::set<std::string, std::less<>> asked_; // keys that the caller knows
};

class TomlDocument {
public:
  [[nodiscard]] static Result<TomlDocument> read(const std::filesystem::path &file);
  [[nodiscard]] static Result<TomlDocument> parse(std::string_view text, const std::string &name);
  [[nodiscard]] TableReader root() const;
  // What the readers of this document have asked for so far: the layout of the file, as it is read and checked.
  [[nodiscard]] const std::vector<KnownKey> &known_keys() const { return sink_->known; }

private:
  TomlDocument() = default;
  std::shared_ptr<const toml::table> table_;
  std::shared_ptr<TableReader::Sink> sink_;
};

} // namespace bregma::base
