#include "casefile/range_curve.hpp"

#include <cmath>
#include <cstddef>
#include <optional>

#include <nlohmann/json.hpp>

#include "base/read_file.hpp"

namespace bregma::casefile {

namespace {

using nlohmann::json;

constexpr std::size_t kMaxCurveBytes = std::size_t{1} << 20;

} // namespace

base::Result<range::PowerLawFit> read_range_curve(const std::filesystem::path &file) {
  const auto text = base::read_file(file, kMaxCurveBytes);
  if (!text) {
    return tl::unexpected(text.error());
  }
  const json document = json::parse(*text, nullptr, false);
  const auto number = [&document](const char *key) -> std::optional<double> {
    const auto found = document.is_object() ? document.find(key) : document.end();
    return found != document.end() && found->is_number() ? std::optional(found->get<double>()) : std::nullopt;
  };
  const auto scale = number("scale_mm");
  const auto exponent = number("exponent");
  if (!scale || !exponent || !(*scale > 0.0) || !std::isfinite(*scale) || !std::isfinite(*exponent) ||
      *exponent == 0.0) {
    return base::failure(file.string() +
                         ": holds no curve (scale_mm, exponent): use what calibrate range --json prints");
  }
  if (const auto accepted = document.find("accepted");
      accepted == document.end() || !accepted->is_boolean() || !accepted->get<bool>()) {
    return base::failure(file.string() + ": this curve was not accepted by its calibration");
  }
  range::PowerLawFit out;
  out.estimated = true;
  out.verdict = range::PowerLawVerdict::kAccepted;
  out.law = {*scale, *exponent};
  if (const auto covariance = document.find("covariance"); covariance != document.end()) {
    for (std::size_t r = 0; r < 2; ++r) {
      const json row = covariance->is_array() && covariance->size() == 2 ? (*covariance)[r] : json();
      if (!row.is_array() || row.size() != 2 || !row[0].is_number() || !row[1].is_number()) {
        return base::failure(file.string() + ": covariance: must be two rows of two numbers");
      }
      out.covariance.row(static_cast<Eigen::Index>(r)) << row[0].get<double>(), row[1].get<double>();
    }
  }
  for (const char *key : {"rms_mm", "corrected_rms_mm"}) {
    if (document.contains(key) && !(number(key).value_or(-1.0) >= 0.0)) {
      return base::failure(file.string() + ": " + key + ": must be a number that is not below 0");
    }
  }
  // A curve of an earlier version has neither misfit nor corrections.
  out.rms_mm = number("rms_mm").value_or(0.0);
  out.corrected_rms_mm = number("corrected_rms_mm").value_or(out.rms_mm);
  if (const auto corrections = document.find("corrections"); corrections != document.end()) {
    for (const json &row : *corrections) {
      const auto finite = [&row](const char *key) {
        return row.is_object() && row.contains(key) && row[key].is_number() && std::isfinite(row[key].get<double>());
      };
      if (!finite("reading") || !finite("add_mm") ||
          (!out.corrections.empty() && !(out.corrections.back().reading < row["reading"].get<double>()))) {
        return base::failure(file.string() + ": corrections: must hold reading and add_mm, with increasing readings");
      }
      out.corrections.push_back({row["reading"].get<double>(), row["add_mm"].get<double>()});
    }
  }
  return out;
}

} // namespace bregma::casefile
