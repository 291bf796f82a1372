// Values of the wire as fields of records. Private to the encoder.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string_view>

#include <Eigen/Geometry>

#include "clients/gateway/records.hpp"
#include "idl/names.hpp"

namespace bregma::gateway {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

inline void copy_name(Name &out, const wire::Name &name) {
  const auto text = wire::view(name);
  text.copy(out, sizeof out - 1);
}
template <std::size_t N> void copy_text(Text &out, const char (&text)[N]) {
  wire::set_text(out, std::string_view(text, strnlen(text, N)));
}
template <std::size_t N> void copy_numbers(double (&out)[N], const double (&in)[N]) { std::copy_n(in, N, out); }
template <std::size_t N> void fill_unknown(double (&out)[N]) { std::fill_n(out, N, kNan); }

// NaN for a pose that is not known: its quaternion is NaN, or 0.
template <std::size_t R, std::size_t T>
void copy_pose(double (&rotation)[R], double (&translation_mm)[T], const wire::Pose &pose) {
  static_assert(R == 9 && T == 3);
  const auto &q = pose.rotation_wxyz;
  const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
  if (!std::isfinite(norm) || norm < 0.5) {
    fill_unknown(rotation);
    fill_unknown(translation_mm);
    return;
  }
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> matrix =
      Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  std::copy_n(matrix.data(), 9, rotation);
  copy_numbers(translation_mm, pose.translation_mm);
}

} // namespace bregma::gateway
