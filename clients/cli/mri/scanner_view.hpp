// The state of the scanner's registration as text and JSON. Values that are not stated are "-" and null.
#pragma once

#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "idl/topics.hpp"

namespace bregma::cli {

// Names of the steps, as they are confirmed. A value that is not known here is "not known here".
[[nodiscard]] std::string_view scanner_step_label(wire::ScannerStep value);
[[nodiscard]] std::string_view scanner_activity_label(wire::ScannerActivity value);
[[nodiscard]] std::string_view scanner_verdict_label(wire::ScannerVerdict value);
[[nodiscard]] std::string_view scanner_validity_label(wire::ScannerValidity value);
[[nodiscard]] std::string_view coil_outcome_label(wire::CoilOutcome value);

// One line: step, what happens, slices, what to do next.
[[nodiscard]] std::string scanner_line(const wire::ScannerRegistration &state);
// The whole state with the report of each coil.
[[nodiscard]] std::string scanner_text(const wire::ScannerRegistration &state);
[[nodiscard]] nlohmann::json scanner_json(const wire::ScannerRegistration &state);

} // namespace bregma::cli
