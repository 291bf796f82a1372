#include "clients/cli/mri/read_out.hpp"

#include <array>
#include <cmath>
#include <string_view>

#include "algorithms/mri/separation.hpp"

namespace bregma::cli {

using Eigen::Vector3d;

base::Result<Vector3d> ras_direction(const std::string &letter) {
  static constexpr std::string_view kLetters = "RLAPSI"; // RAS
  const auto at = letter.size() == 1 ? kLetters.find(letter[0]) : std::string_view::npos;
  if (at == std::string_view::npos) {
    return base::failure("the direction \"" + letter + "\" is not one of R, L, A, P, S, I");
  }
  const double sign = at % 2 == 0 ? 1.0 : -1.0;
  return Vector3d(sign * Vector3d::Unit(static_cast<Eigen::Index>(at / 2)));
}

base::Result<Vector3d> movement_in(const Eigen::Matrix4d &T_ras_index, const std::string &read_out, double bandwidth_Hz,
                                   const std::optional<casefile::ScanHeader> &header) {
  const auto towards = ras_direction(read_out);
  if (!towards) {
    return tl::unexpected(towards.error());
  }
  constexpr double kAlong = 0.7; // cosine
  if (header && header->read_out) {
    const Vector3d ras(-header->read_out->x(), -header->read_out->y(), header->read_out->z());
    if (!(std::abs(ras.normalized().dot(*towards)) > kAlong)) {
      Eigen::Index axis = 0;
      ras.cwiseAbs().maxCoeff(&axis);
      static constexpr std::array kAxes = {"R and L", "A and P", "S and I"};
      return base::failure("the read-out \"" + read_out + "\" is across that of its header, which runs along " +
                           kAxes.at(static_cast<std::size_t>(axis)) + " (phase encoding " + header->phase_encoding +
                           ")");
    }
  }
  if (bandwidth_Hz == 0.0 && header) {
    bandwidth_Hz = header->bandwidth_Hz;
  }
  if (!(bandwidth_Hz > 0.0)) {
    return base::failure(
        "the bandwidth per pixel is not stated; state it by --bandwidth-Hz, in a list of scans by bandwidth_Hz");
  }
  Vector3d nearest = Vector3d::Zero();
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const Vector3d step = T_ras_index.block<3, 1>(0, axis);
    if (std::abs(step.normalized().dot(*towards)) >
        (nearest.isZero() ? 0.0 : std::abs(nearest.normalized().dot(*towards)))) {
      nearest = step;
    }
  }
  const double sign = nearest.dot(*towards) < 0.0 ? -1.0 : 1.0;
  const double pixel_mm = header && header->read_out_pixel_mm > 0.0 ? header->read_out_pixel_mm : nearest.norm();
  return mri::b0_movement(sign * nearest.normalized(), pixel_mm, bandwidth_Hz);
}

std::string b0_note(const mri::ScanFields &fields, const std::optional<Vector3d> &mm_per_Hz, const std::string &where) {
  constexpr double kSame = 0.05; // relative
  if (!mm_per_Hz) {
    return fields.has_b0() ? "the part of B0 is not corrected; state the read-out by " + where : "";
  }
  if (fields.has_b0()) {
    return "";
  }
  if (fields.mm_per_Hz().isZero()) {
    return "does not state the read-out that it was measured with: its B0 is taken for that of this one";
  }
  return (fields.mm_per_Hz() - *mm_per_Hz).norm() > kSame * mm_per_Hz->norm()
             ? "was measured with another read-out, pixel or bandwidth, by which B0 is corrected; scans of the phantom "
               "with both read-outs correct that of every scan"
             : "";
}

} // namespace bregma::cli
