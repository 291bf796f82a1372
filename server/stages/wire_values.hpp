// Conversions between arrays of DDS messages and Eigen, common to the pipelines. No allocation.
#pragma once

#include <algorithm>

#include "algorithms/uncertainty/tre.hpp"
#include "idl/names.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;
namespace frame = geometry::frame;

// Matrices in DDS and stage messages are row-major.
template <int N> using RowMajor = Eigen::Matrix<double, N, N, Eigen::RowMajor>;

[[nodiscard]] inline Vector3d vector_of(const Array3 &values) { return Vector3d::Map(values.data()); }
[[nodiscard]] inline Matrix3d matrix_of(const Array9 &values) { return RowMajor<3>::Map(values.data()); }
[[nodiscard]] inline Matrix6d matrix_of(const Array36 &values) { return RowMajor<6>::Map(values.data()); }

[[nodiscard]] inline Array3 array_of(const Vector3d &values) { return {values.x(), values.y(), values.z()}; }
[[nodiscard]] inline Array9 array_of(const Matrix3d &values) {
  Array9 out;
  RowMajor<3>::Map(out.data()) = values;
  return out;
}

inline void put(const Vector3d &values, double (&out)[3]) { Vector3d::Map(out) = values; }
inline void put(const Matrix3d &values, double (&out)[9]) { RowMajor<3>::Map(out) = values; }
inline void put(const Matrix6d &values, double (&out)[36]) { RowMajor<6>::Map(out) = values; }

template <std::size_t N> void put_unknown(double (&out)[N]) { std::fill_n(out, N, wire::kUnknown); }

[[nodiscard]] inline wire::Ellipsoid to_wire(const uncertainty::Ellipsoid95 &ellipsoid) {
  wire::Ellipsoid out;
  put(ellipsoid.semi_axes_mm, out.semi_axes_mm);
  put(ellipsoid.axes, out.axes);
  return out;
}

[[nodiscard]] inline wire::Ellipsoid unknown_ellipsoid() {
  wire::Ellipsoid out;
  put_unknown(out.semi_axes_mm);
  put_unknown(out.axes);
  return out;
}

inline void copy_name(wire::Name &to, const wire::Name &from) { std::copy_n(from, sizeof(wire::Name), to); }
[[nodiscard]] inline bool same(const wire::Name &a, const wire::Name &b) { return wire::view(a) == wire::view(b); }

} // namespace bregma::server
