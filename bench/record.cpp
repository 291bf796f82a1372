#include "bench/record.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <utility>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

namespace bregma::bench {

bool Record::holds() const {
  switch (bound) {
  case Bound::kAtMost:
    return value <= limit; // false for NaN
  case Bound::kAtLeast:
    return value >= limit;
  case Bound::kNone:
    break;
  }
  return true;
}

Record figure(std::string name, double value, std::string unit) {
  return {.name = std::move(name), .value = value, .unit = std::move(unit), .peer = std::nullopt, .peer_name = {}};
}

Record at_most(std::string name, double value, std::string unit, double limit) {
  Record out = figure(std::move(name), value, std::move(unit));
  out.bound = Record::Bound::kAtMost;
  out.limit = limit;
  return out;
}

Record at_least(std::string name, double value, std::string unit, double limit) {
  Record out = at_most(std::move(name), value, std::move(unit), limit);
  out.bound = Record::Bound::kAtLeast;
  return out;
}

Record with_peer(Record record, double peer, std::string peer_name) {
  record.peer = peer;
  record.peer_name = std::move(peer_name);
  return record;
}

Report::Report(bool json) : json_(json) {}

void Report::add(const Record &record) {
  all_hold_ = all_hold_ && record.holds();
  const bool bounded = record.bound != Record::Bound::kNone;
  if (json_) {
    nlohmann::ordered_json line{{"name", record.name}, {"value", record.value}, {"unit", record.unit}};
    line["limit"] = bounded ? nlohmann::ordered_json(record.limit) : nlohmann::ordered_json(nullptr);
    line["holds"] = bounded ? nlohmann::ordered_json(record.holds()) : nlohmann::ordered_json(nullptr);
    line["peer"] = record.peer ? nlohmann::ordered_json(*record.peer) : nlohmann::ordered_json(nullptr);
    line["peer_name"] = record.peer_name;
    std::cout << line.dump() << std::endl;
    return;
  }
  if (!std::exchange(header_printed_, true)) {
    std::printf("%-52s %12s %-8s %14s %-6s %s\n", "name", "value", "unit", "limit", "holds", "floor or peer");
  }
  char limit[32] = "-";
  if (bounded) {
    std::snprintf(limit, sizeof limit, "%s %.4g", record.bound == Record::Bound::kAtMost ? "<=" : ">=", record.limit);
  }
  char peer[96] = "-";
  if (record.peer) {
    std::snprintf(peer, sizeof peer, "%.4g (%s)", *record.peer, record.peer_name.c_str());
  }
  std::printf("%-52s %12.4g %-8s %14s %-6s %s\n", record.name.c_str(), record.value, record.unit.c_str(), limit,
              bounded ? (record.holds() ? "yes" : "NO") : "-", peer);
  std::fflush(stdout);
}

void Report::note(std::string_view text) const {
  if (!json_) {
    std::printf("# %.*s\n", static_cast<int>(text.size()), text.data());
    std::fflush(stdout);
  }
}

Progress::Progress(std::string study, int runs)
    : study_(std::move(study)), runs_(runs), said_(std::chrono::steady_clock::now()) {}

void Progress::step() {
  constexpr auto kInterval = std::chrono::seconds(5);
  ++done_;
  if (const auto now = std::chrono::steady_clock::now(); now - said_ >= kInterval) {
    said_ = now;
    std::fprintf(stderr, "%s: %d of %d\n", study_.c_str(), done_, runs_);
  }
}

bool Options::wants(std::string_view part) const {
  return only.empty() || std::find(only.begin(), only.end(), part) != only.end();
}

void add_options(CLI::App &app, Options &options, const std::vector<std::string> &parts) {
  app.add_flag("--json", options.json, "one JSON object per line");
  app.add_flag("--quick", options.quick, "a smaller sample, in under a minute");
  if (!parts.empty()) {
    app.add_option("--only", options.only, "these parts alone")->check(CLI::IsMember(parts));
  }
}

double percentile(std::vector<double> &values, double p) {
  if (values.empty()) {
    return std::nan("");
  }
  std::sort(values.begin(), values.end());
  const double rank = p * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(rank);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  return values[low] + (rank - static_cast<double>(low)) * (values[high] - values[low]);
}

} // namespace bregma::bench
