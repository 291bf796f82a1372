// What the thread sanitizer is not to report. Link it into programs that log.
//
// Debian's libspdlog is not built with the sanitizer, which therefore does not see how its threads share reference
// counts and takes the release of a sink for a race. Our own code is not exempted: none of it is in namespace spdlog.

// NOLINTNEXTLINE(bugprone-reserved-identifier,readability-identifier-naming)
extern "C" const char *__tsan_default_suppressions() { return "race:spdlog::\n"; }
