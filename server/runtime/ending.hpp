// A limit for the end of the process: a disk that hangs, or a thread that waits for one, must not keep it running.
#pragma once

#include <chrono>

namespace bregma::runtime {

inline constexpr int kEndedByLimit = 3; // exit status

// Ends the process after this time, at the latest, as by SIGKILL: what is not on disk by then is lost. A log line says
// so. Call it once.
void end_within(std::chrono::milliseconds limit);

} // namespace bregma::runtime
