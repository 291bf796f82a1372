// Writes session files with known figures.
#pragma once

#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "casefile/session_file/session_file.hpp"
#include "idl/names.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::test {

inline constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
inline constexpr std::int64_t kMs = 1'000'000;

// Content of a navigated run of 200 frames at 250 Hz with a resting tool.
struct RunPlan {
  bool truth = true;
  int frames = 200;
  int first_at_target = 100; // frames from here on are at the target
  // Error of a frame's displayed tip along x, mm.
  std::function<double(int)> error_mm = [](int) { return 0.5; };
  double registration_shift_mm = 0.4; // shift between the accepted registration and the true one
};

wire::RegistrationState accepted_registration(double shift_mm);
void write_run(casefile::SessionWriter &writer, const RunPlan &plan);

template <class T> void put(casefile::SessionWriter &writer, std::int64_t time_ns, const T &sample) {
  const auto written = writer.write(time_ns, sample);
  ASSERT_TRUE(written.has_value()) << written.error().message;
}

// A command of this kind and its reply at a time.
void put_command(casefile::SessionWriter &writer, std::int64_t time_ns, std::uint64_t id, wire::CommandKind kind,
                 wire::SessionState after, double value_mm = wire::kUnknown, const char *point = "");

} // namespace bregma::test
