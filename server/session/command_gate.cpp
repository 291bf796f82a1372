#include "server/session/command_gate.hpp"

#include <algorithm>

namespace bregma::server {

bool CommandGate::Bucket::take() {
  const bool enough = tokens >= 1.0;
  tokens -= enough ? 1.0 : 0.0;
  return enough;
}

void CommandGate::Bucket::fill(double by, double max) { tokens = std::min(tokens + by, max); }

CommandGate::Verdict CommandGate::judge(std::uint64_t writer, std::int64_t now_ns) {
  Writer &known = find(writer, now_ns);
  const double elapsed_s = static_cast<double>(std::max<std::int64_t>(now_ns - known.last_ns, 0)) * 1e-9;
  known.last_ns = now_ns;
  known.commands.fill(kRate_hz * elapsed_s, kBurst);
  known.refusals.fill(kRefusalRate_hz * elapsed_s, kRefusalRate_hz);
  if (known.commands.take()) {
    return Verdict::kAdmitted;
  }
  ++excess_;
  return known.refusals.take() ? Verdict::kRefused : Verdict::kIgnored;
}

CommandGate::Writer &CommandGate::find(std::uint64_t id, std::int64_t now_ns) {
  const auto found =
      std::find_if(writers_.begin(), writers_.end(), [id](const Writer &writer) { return writer.id == id; });
  if (found != writers_.end()) {
    return *found;
  }
  const Writer fresh{id, now_ns, {kBurst}, {kRefusalRate_hz}};
  if (writers_.size() < kMaxWriters) {
    return writers_.emplace_back(fresh);
  }
  auto silent = std::min_element(writers_.begin(), writers_.end(),
                                 [](const Writer &a, const Writer &b) { return a.last_ns < b.last_ns; });
  *silent = fresh;
  return *silent;
}

} // namespace bregma::server
