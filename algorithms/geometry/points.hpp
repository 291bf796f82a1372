// Clouds of points in the plane or in space: one column per point, mm.
#pragma once

#include <Eigen/Core>

namespace bregma::geometry {

template <int D> using Points = Eigen::Matrix<double, D, Eigen::Dynamic>;
using Points2 = Points<2>;
using Points3 = Points<3>;

} // namespace bregma::geometry
