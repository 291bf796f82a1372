// Limits the rate of commands of each writer, so that a program that floods the daemon delays nobody else. Excess
// commands are refused without further work: they are neither carried out, nor recorded, nor logged one by one.
// Threads: one at a time. The caller passes the time (of any clock that does not step).
#pragma once

#include <cstdint>
#include <vector>

namespace bregma::server {

class CommandGate {
public:
  static constexpr double kRate_hz = 50.0;       // lasting rate per writer: more than any operator or script needs
  static constexpr double kBurst = 200.0;        // at once
  static constexpr double kRefusalRate_hz = 5.0; // answered refusals per writer; the others have no answer
  static constexpr std::size_t kMaxWriters = 64; // beyond: the writer that was silent for longest is forgotten

  enum class Verdict : std::uint8_t { kAdmitted, kRefused, kIgnored }; // kRefused: to be answered as such
  // writer: SampleInfo::writer.
  [[nodiscard]] Verdict judge(std::uint64_t writer, std::int64_t now_ns);
  // Refused and ignored since the start.
  [[nodiscard]] std::uint64_t excess() const { return excess_; }

private:
  // Tokens accumulate at a rate up to a maximum; each command takes one.
  struct Bucket {
    double tokens;
    [[nodiscard]] bool take();
    void fill(double by, double max);
  };
  struct Writer {
    std::uint64_t id;
    std::int64_t last_ns;
    Bucket commands;
    Bucket refusals;
  };
  [[nodiscard]] Writer &find(std::uint64_t id, std::int64_t now_ns);

  std::vector<Writer> writers_;
  std::uint64_t excess_ = 0;
};

} // namespace bregma::server
