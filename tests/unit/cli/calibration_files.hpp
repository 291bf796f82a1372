// Recordings for `bregma calibrate` whose results are known.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include <Eigen/Geometry>

#include "tests/support/temporary_folder.hpp"

namespace bregma::tests {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using test::TemporaryFolder;

// A tool with its tip at (0, 100, 0) that rotates about the origin by turn_rad about both axes, with errors of 0.15 mm.
inline void write_poses(const TemporaryFolder &folder, int count, double turn_rad) {
  for (int i = 0; i < count; ++i) {
    const double a = turn_rad * std::sin(0.37 * i);
    const double b = turn_rad * std::sin(0.23 * i + 1.0);
    // R = Rx(a) Rz(b); t = -R tip
    const double ca = std::cos(a), sa = std::sin(a), cb = std::cos(b), sb = std::sin(b);
    const auto error = [i](int axis) { return 0.2 * std::sin(1.7 * i * i + 2.0 * axis); };
    char text[512];
    std::snprintf(text, sizeof text, "%.12f %.12f 0 %.12f\n%.12f %.12f %.12f %.12f\n%.12f %.12f %.12f %.12f\n0 0 0 1\n",
                  cb, -sb, 100.0 * sb + error(0), ca * sb, ca * cb, -sa, -100.0 * ca * cb + error(1), sa * sb, sa * cb,
                  ca, -100.0 * sa * cb + error(2));
    folder.write("poses/" + std::to_string(1'000'000'000 + 50'000'000LL * i) + ".txt", text);
  }
}

inline Isometry3d pose(const Vector3d &turn, const Vector3d &at) {
  Isometry3d out = Isometry3d::Identity();
  out.linear() = Eigen::AngleAxisd(turn.norm() + 1e-12, (turn + 1e-12 * Vector3d::UnitX()).normalized()).matrix();
  out.translation() = at;
  return out;
}

inline Vector3d wave(int i, double scale) {
  return scale * Vector3d(std::sin(1.7 * i), std::sin(2.3 * i + 1.0), std::sin(0.9 * i + 2.0));
}

inline std::string text_of(const Isometry3d &T) {
  std::string out;
  for (int r = 0; r < 4; ++r) {
    std::array<char, 160> line{};
    std::snprintf(line.data(), line.size(), "%.15g %.15g %.15g %.15g\n", T(r, 0), T(r, 1), T(r, 2), T(r, 3));
    out += line.data();
  }
  return out;
}

// Poses of a flange and of a body on it, of the same times; their turns are scaled per axis.
inline void write_hand_eye(const TemporaryFolder &folder, const Vector3d &turns) {
  const Isometry3d X = pose({0.1, 0.2, -0.3}, {20.0, -35.0, 90.0});
  const Isometry3d Y = pose({0.4, -0.2, 1.0}, {150.0, -300.0, 1400.0});
  for (int i = 0; i < 15; ++i) {
    const Isometry3d A = pose(wave(i, 0.6).cwiseProduct(turns), Vector3d(400.0, 0.0, 500.0) + wave(3 * i + 1, 100.0));
    const std::string name = std::to_string(1'000'000'000 + 50'000'000LL * i) + ".txt";
    folder.write("flange/" + name, text_of(A));
    folder.write("body/" + name, text_of(Y.inverse() * A * X));
  }
  folder.write("body/9000000000.txt", text_of(X));
}

// A beam's readings of the plane z = 0, in "plane.csv"; the flange turns by about `turn` rad.
inline void write_plane_scan(const TemporaryFolder &folder, double turn) {
  const Vector3d origin(12.0, -8.0, 45.0);
  const Vector3d direction = Vector3d(0.03, -0.05, 1.0).normalized();
  std::string text = "x_mm,y_mm,z_mm,qw,qx,qy,qz,range_mm\n";
  for (int i = 0; i < 120; ++i) {
    const Isometry3d T =
        pose(Vector3d(3.0, 0.0, 0.0) + wave(i, turn), Vector3d(0.0, 0.0, 250.0) + wave(2 * i + 1, 60.0));
    const Vector3d foot = T * origin;
    const double range = -foot.z() / (T.linear() * direction).z(); // down to z = 0
    const Eigen::Quaterniond q(T.linear());
    std::array<char, 300> line{};
    std::snprintf(line.data(), line.size(), "%.12g,%.12g,%.12g,%.15g,%.15g,%.15g,%.15g,%.12g\n", T.translation().x(),
                  T.translation().y(), T.translation().z(), q.w(), q.x(), q.y(), q.z(), range);
    text += line.data();
  }
  folder.write("plane.csv", text);
}

// distance = 270 mm * reading^-1.2, in "readings.csv".
inline void write_readings(const TemporaryFolder &folder) {
  std::string text = "reading,distance_mm\n";
  for (int mm = 100; mm <= 300; mm += 5) {
    std::array<char, 60> line{};
    std::snprintf(line.data(), line.size(), "%.12g,%d\n", std::pow(mm / 270.0, -1.0 / 1.2), mm);
    text += line.data();
  }
  folder.write("readings.csv", text);
}

} // namespace bregma::tests
