// One figure of a benchmark, printed the same way by all of them: a table row for people, one JSON object a line with
// --json. A limit is the figure that the design asks for; a peer is what was measured beside it in the same run.
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
  std::optional<double> peer; // the floor, or another solver, measured in the same run
  std::string peer_name;

  [[nodiscard]] bool holds() const;
};

[[nodiscard]] Record figure(std::string name, double value, std::string unit);
[[nodiscard]] Record at_most(std::string name, double value, std::string unit, double limit);
[[nodiscard]] Record at_least(std::string name, double value, std::string unit, double limit);
[[nodiscard]] Record with_peer(Record record, double peer, std::string peer_name);

// Prints as figures come. Not for several threads.
class Report {
public:
  explicit Report(bool json);
  void add(const Record &record);
  void note(std::string_view text) const; // what was measured and how; not printed with --json
  [[nodiscard]] bool all_hold() const { return all_hold_; }

private:
  bool json_;
  bool all_hold_ = true;
  bool header_printed_ = false;
};

// How far a long study is, on standard error: at most one line in five seconds.
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

// The options that every benchmark takes.
struct Options {
  bool json = false;
  bool quick = false;
  std::vector<std::string> only; // parts; empty: all
  [[nodiscard]] bool wants(std::string_view part) const;
};
// parts: of the benchmark, for --only; it has no such option without them.
void add_options(CLI::App &app, Options &options, const std::vector<std::string> &parts = {});

// p in 0..1, by linear interpolation between ranks; sorts in place.
[[nodiscard]] double percentile(std::vector<double> &values, double p);

} // namespace bregma::bench
