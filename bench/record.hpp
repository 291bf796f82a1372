// One figure of a benchmark, with the same output in all of them: a table row, or one JSON object per line with --json.
// A limit is the figure that the design requires; a peer is a figure for comparison, measured in the same run or
// published.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

namespace bregma::bench {

struct Record {
  std::string name;
  double value = 0.0;
  std::string unit;
  enum class Bound { kNone, kAtMost, kAtLeast } bound = Bound::kNone;
  double limit = 0.0;
  std::optional<double> peer; // figure for comparison: a floor, another solver, a publication
  std::string peer_name;

  [[nodiscard]] bool holds() const;
};

[[nodiscard]] Record figure(std::string name, double value, std::string unit);
[[nodiscard]] Record at_most(std::string name, double value, std::string unit, double limit);
[[nodiscard]] Record at_least(std::string name, double value, std::string unit, double limit);
[[nodiscard]] Record with_peer(Record record, double peer, std::string peer_name);

// Prints each figure when it is added. Not for several threads.
class Report {
public:
  explicit Report(bool json);
  void add(const Record &record);
  void note(std::string_view text) const; // description of the measurement; not printed with --json
  [[nodiscard]] bool all_hold() const { return all_hold_; }

private:
  bool json_;
  bool all_hold_ = true;
  bool header_printed_ = false;
};

// Progress of a long study on standard error: at most one line per five seconds.
class Progress {
public:
  Progress(std::string study, int runs);
  void step();

private:
  std::string study_;
  int runs_;
  int done_ = 0;
  std::chrono::steady_clock::time_point said_;
};

// The options of every benchmark.
struct Options {
  bool json = false;
  bool quick = false;
  std::vector<std::string> only; // parts; empty: all
  [[nodiscard]] bool wants(std::string_view part) const;
};
// parts: the benchmark's parts, for --only; without parts it has no such option.
void add_options(CLI::App &app, Options &options, const std::vector<std::string> &parts = {});

// p in 0..1, by linear interpolation between ranks; sorts in place.
[[nodiscard]] double percentile(std::vector<double> &values, double p);

} // namespace bregma::bench
