#include "drivers/sim/scanner/acquisition.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "drivers/sim/scanner/flat_index.hpp"
#include "drivers/sim/scanner/point_spread.hpp"

namespace bregma::sim::scanner {

namespace {

constexpr double kNode_mm = 5.0;
constexpr int kTile = 8; // dense samples

// Device from the paper's (sagittal, coronal, transverse) of DICOM, for a patient on the back, head first.
Vector3d from_patient(const Vector3d &lps) { return {lps.x(), -lps.y(), -lps.z()}; }

int subslices(double thickness_mm) { return std::max(3, static_cast<int>(std::ceil(1.2 * thickness_mm / 0.5))); }

} // namespace

Protocol phantom_protocol() {
  Protocol out;
  out.name = "phantom";
  out.fov_mm = 256.0;
  out.matrix = 256;
  out.thickness_mm = 1.0;
  out.echo_ms = 2.98;
  out.repetition_ms = 5000.0;
  return out;
}

Protocol coil_protocol(int slices) {
  Protocol out;
  out.name = "coils";
  out.repetition_ms = slices <= 60 ? 528.0 : slices <= 100 ? 880.0 : 1060.0;
  return out;
}

const char *name(Plane plane) {
  switch (plane) {
  case Plane::kCoronal:
    return "coronal";
  case Plane::kSagittal:
    return "sagittal";
  case Plane::kTransverse:
    return "transverse";
  case Plane::kDoubleOblique:
    return "double oblique";
  }
  return "";
}

StackPlan plan_of(Plane plane, const Vector3d &centre_mm, int slices) {
  StackPlan out;
  out.centre_mm = centre_mm;
  out.slices = slices;
  switch (plane) {
  case Plane::kCoronal:
    out.along_row = from_patient(Vector3d::UnitX());
    out.along_column = from_patient(-Vector3d::UnitZ());
    break;
  case Plane::kSagittal:
    out.along_row = from_patient(Vector3d::UnitY());
    out.along_column = from_patient(-Vector3d::UnitZ());
    break;
  case Plane::kTransverse:
    out.along_row = from_patient(Vector3d::UnitX());
    out.along_column = from_patient(Vector3d::UnitY());
    break;
  case Plane::kDoubleOblique: {
    const double a = 38.3 * M_PI / 180.0, b = 10.0 * M_PI / 180.0;
    const Vector3d normal(std::sin(b), std::sin(a) * std::cos(b), std::cos(a) * std::cos(b));
    const Vector3d row = (Vector3d::UnitX() - normal.x() * normal).normalized();
    out.along_row = from_patient(row);
    out.along_column = from_patient(normal.cross(row));
    break;
  }
  }
  return out;
}

Acquisition::Acquisition(const ScannerField &field, const Protocol &protocol, const StackPlan &plan)
    : field_(&field), protocol_(protocol), plan_(plan),
      per_Hz_mm_(plan.read_out() * (protocol.pixel_mm() / protocol.bandwidth_Hz) +
                 plan.normal() * (protocol.thickness_mm / protocol.pulse_Hz)) {}

image::Grid<3> Acquisition::grid() const {
  image::Grid<3> out;
  out.size = {protocol_.matrix, protocol_.matrix, plan_.slices};
  const double pixel = protocol_.pixel_mm();
  out.T_image_index.topLeftCorner<3, 3>() << plan_.along_row * pixel, plan_.along_column * pixel,
      plan_.normal() * protocol_.thickness_mm;
  const Vector3d middle(0.5 * (protocol_.matrix - 1), 0.5 * (protocol_.matrix - 1), 0.5 * (plan_.slices - 1));
  out.T_image_index.topRightCorner<3, 1>() = plan_.centre_mm - out.axes() * middle;
  return out;
}

Vector3d Acquisition::believed_mm(const Vector3d &true_mm) const {
  const Eigen::Array4f d = field_->at(true_mm);
  return true_mm + d.head<3>().matrix().cast<double>() + static_cast<double>(d[3]) * per_Hz_mm_;
}

Vector3d Acquisition::true_mm(const Vector3d &believed) const {
  Vector3d r = believed;
  for (int n = 0; n < 12; ++n) {
    const Vector3d miss = believed - believed_mm(r);
    r += miss;
    if (miss.squaredNorm() < 1e-10) {
      break;
    }
  }
  return r;
}

void Acquisition::invert() const {
  // The box around the stack, with a margin for the point spread.
  const image::Grid<3> g = grid();
  Vector3d low = Vector3d::Constant(1e9), high = -low;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3d index((corner & 1) != 0 ? g.size[0] : -1, (corner & 2) != 0 ? g.size[1] : -1,
                         (corner & 4) != 0 ? g.size[2] : -1);
    low = low.cwiseMin(g.point_mm(index));
    high = high.cwiseMax(g.point_mm(index));
  }
  first_mm_ = low.array() - 2.0 * kNode_mm;
  for (int d = 0; d < 3; ++d) {
    nodes_[static_cast<std::size_t>(d)] = static_cast<int>(std::ceil((high - low)[d] / kNode_mm)) + 5;
  }
  const auto offset = [&](int i, int j, int k) { return detail::flat(i, j, k, nodes_[0], nodes_[1]); };
  inverse_.assign(offset(0, 0, nodes_[2]), Eigen::Array4f::Zero());
  for (int k = 0; k < nodes_[2]; ++k) {
    for (int j = 0; j < nodes_[1]; ++j) {
      for (int i = 0; i < nodes_[0]; ++i) {
        const Vector3d x = first_mm_ + kNode_mm * Vector3d(i, j, k);
        inverse_[offset(i, j, k)].head<3>() = (true_mm(x) - x).cast<float>();
      }
    }
  }
  for (int k = 0; k < nodes_[2]; ++k) {
    for (int j = 0; j < nodes_[1]; ++j) {
      for (int i = 0; i < nodes_[0]; ++i) {
        Eigen::Matrix3f J = Eigen::Matrix3f::Identity();
        const std::array<int, 3> at{i, j, k};
        for (std::size_t d = 0; d < 3; ++d) {
          std::array<int, 3> before = at, after = at;
          before[d] = std::max(0, at[d] - 1);
          after[d] = std::min(nodes_[d] - 1, at[d] + 1);
          const Eigen::Array3f change = inverse_[offset(after[0], after[1], after[2])].head<3>() -
                                        inverse_[offset(before[0], before[1], before[2])].head<3>();
          J.col(static_cast<Eigen::Index>(d)) +=
              change.matrix() / (static_cast<float>(kNode_mm) * static_cast<float>(after[d] - before[d]));
        }
        inverse_[offset(i, j, k)][3] = J.determinant();
      }
    }
  }
}

Eigen::Array4f Acquisition::inverse_at(const Vector3d &believed) const {
  std::array<int, 3> cell{};
  Eigen::Array3f f;
  for (int d = 0; d < 3; ++d) {
    const auto D = static_cast<std::size_t>(d);
    const double x = std::clamp((believed[d] - first_mm_[d]) / kNode_mm, 0.0, nodes_[D] - 1.001);
    cell[D] = static_cast<int>(x);
    f[d] = static_cast<float>(x - cell[D]);
  }
  const int across = nodes_[0];
  const Eigen::Array4f *p = &inverse_[detail::flat(cell[0], cell[1], cell[2], across, nodes_[1])];
  const auto line = [&](const Eigen::Array4f *q) -> Eigen::Array4f { return q[0] + f[0] * (q[1] - q[0]); };
  const auto face = [&](const Eigen::Array4f *q) -> Eigen::Array4f {
    const Eigen::Array4f a = line(q);
    return a + f[1] * (line(q + across) - a);
  };
  const Eigen::Array4f a = face(p);
  return a + f[2] * (face(p + detail::flat(0, 0, 1, across, nodes_[1])) - a);
}

Stack Acquisition::clean(const Body &body, const BodyPose &T_device_body, std::span<const Vector3d> region_mm) const {
  if (inverse_.empty()) {
    invert();
  }
  Stack out;
  static_cast<image::Grid<3> &>(out) = grid();
  out.voxels.assign(out.pixels(), 0.0F);
  const auto T_body_device = T_device_body.inverse();
  const Eigen::Matrix3d R = T_body_device.rotation_matrix();
  const Vector3d &t = T_body_device.translation();
  const int n = protocol_.matrix;
  const int wide = detail::kDense * n + 2 * detail::kMargin; // even
  const int layers = subslices(protocol_.thickness_mm);
  const double ramp = protocol_.pixel_mm() / detail::kDense;
  const auto place = [&](double x, double y, double slice) {
    return out.point_mm(
        Vector3d((x - detail::kMargin) / detail::kDense, (y - detail::kMargin) / detail::kDense, slice));
  };
  const auto sample = [&](const Vector3d &believed, double edge) {
    const Eigen::Array4f e = inverse_at(believed);
    const Vector3d r = believed + e.head<3>().matrix().cast<double>();
    return static_cast<float>(body.water(R * r + t, edge)) * e[3];
  };
  double weights = 0.0;
  for (int layer = 0; layer < layers; ++layer) {
    weights += detail::slice_profile(1.2 * ((layer + 0.5) / layers - 0.5));
  }
  std::vector<float> dense(static_cast<std::size_t>(wide) * static_cast<std::size_t>(wide)), scratch;
  const auto at = [&](int x, int y) -> float & {
    return dense[static_cast<std::size_t>(y) * static_cast<std::size_t>(wide) + static_cast<std::size_t>(x)];
  };
  const double reach2 = std::pow(kRegion_mm + kTile * protocol_.pixel_mm(), 2);
  for (int slice = 0; slice < plan_.slices; ++slice) {
    for (int top = 0; top < wide; top += kTile) {
      for (int left = 0; left < wide; left += kTile) {
        const Vector3d middle = place(left + 0.5 * kTile, top + 0.5 * kTile, slice);
        const bool fine = region_mm.empty() || std::any_of(region_mm.begin(), region_mm.end(), [&](const Vector3d &p) {
                            return (p - middle).squaredNorm() < reach2;
                          });
        const int step = fine ? 1 : detail::kDense;
        for (int y = top; y < std::min(wide, top + kTile); y += step) {
          for (int x = left; x < std::min(wide, left + kTile); x += step) {
            if (!fine) {
              const float value = sample(place(x + 0.5, y + 0.5, slice), protocol_.pixel_mm());
              at(x, y) = at(x + 1, y) = at(x, y + 1) = at(x + 1, y + 1) = value;
              continue;
            }
            float sum = 0.0F;
            for (int layer = 0; layer < layers; ++layer) {
              const double depth = 1.2 * ((layer + 0.5) / layers - 0.5);
              sum += static_cast<float>(detail::slice_profile(depth)) * sample(place(x, y, slice + depth), ramp);
            }
            at(x, y) = sum / static_cast<float>(weights);
          }
        }
      }
    }
    detail::spread(dense, n, n, &out.voxels[out.offset(0, 0, slice)], scratch);
  }
  return out;
}

} // namespace bregma::sim::scanner
