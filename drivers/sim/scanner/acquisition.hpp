// A multi-slice gradient echo of the simulated scanner, from spins to a magnitude image.
//
// Where the scanner believes a spin to be: x = r + g(r) + e_readout B0(r) pixel / bandwidth + e_slice B0(r) thickness /
// pulse bandwidth. The pixel at x shows the spins that are believed there, times the change of volume from r to x: so
// slices are curved and crowded spins are bright. Samples lie twice as densely as pixels and several to a slice, are
// summed over the slice's profile, and pass the point spread of a Hamming window in k-space.
//
// Strong local fields (a coil that carries current, an air bubble) turn and move spins so steeply that this map cannot
// be inverted. There a lattice of spins is deposited forwards, each with its phase exp(2 pi i f TE), once with the
// field and once without, and the difference is added.
//
// Frame: device (mm). Images have T_device_index as T_image_index. Not for several threads at a time.
#pragma once

#include <complex>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/image/grid.hpp"
#include "drivers/sim/random.hpp"
#include "drivers/sim/scanner/bodies.hpp"
#include "drivers/sim/scanner/scanner_field.hpp"

namespace bregma::sim::scanner {

using Stack = image::Image<float, 3>;

inline constexpr double kGamma_HzPerT = 42.577478518e6;

struct Protocol {
  std::string name;
  double fov_mm = 300.0;
  int matrix = 192;
  double thickness_mm = 1.5;   // and distance between slices
  double bandwidth_Hz = 260.0; // per pixel
  double pulse_Hz = 1500.0;    // of the slice-selective pulse
  double echo_ms = 4.70;
  double repetition_ms = 528.0;
  [[nodiscard]] double pixel_mm() const { return fov_mm / matrix; }
  [[nodiscard]] double duration_s() const { return repetition_ms * 1e-3 * matrix; } // all slices share a repetition
};
[[nodiscard]] Protocol phantom_protocol();        // step 2 of [Tuna 2022, V-B]: 1 mm, 256
[[nodiscard]] Protocol coil_protocol(int slices); // steps 4 to 7: 1.5 mm, 300 mm, 192

enum class Plane { kCoronal, kSagittal, kTransverse, kDoubleOblique };
[[nodiscard]] const char *name(Plane plane);

// Where slices lie, in the frame Device.
struct StackPlan {
  Vector3d along_row = Vector3d::UnitX();
  Vector3d along_column = Vector3d::UnitZ();
  Vector3d centre_mm = Vector3d::Zero(); // of the whole stack
  int slices = 60;
  bool read_along_rows = true;
  bool read_reversed = false; // the read-out runs towards smaller indices
  [[nodiscard]] Vector3d normal() const { return along_row.cross(along_column); }
  [[nodiscard]] Vector3d read_out() const {
    return (read_reversed ? -1.0 : 1.0) * (read_along_rows ? along_row : along_column);
  }
};
// Double oblique: T>C38.3>S10.0 as in the paper.
[[nodiscard]] StackPlan plan_of(Plane plane, const Vector3d &centre_mm, int slices);

// A field so local that its spins are followed one by one.
struct LocalField {
  std::vector<Vector3d> centres_mm;
  double reach_mm = 22.0;
  double step_mm = 0.5; // between spins
  std::function<double(const Vector3d &)> frequency_Hz;
  std::function<bool(const Vector3d &)> is_empty; // no spins there while the field is on (air); may be empty
};

struct Appearance {
  double water = 1000.0;
  double snr = 30.0;     // of water; Rician. 0: no noise
  double shading = 0.15; // of the receiver coils
};

class Acquisition {
public:
  Acquisition(const ScannerField &field, const Protocol &protocol, const StackPlan &plan);

  // Water of 1, without noise. T_device_body: where the body really is. Where a region is given, samples farther than
  // kRegion_mm from all its points are as coarse as pixels and one to a slice: for scans of which only coils matter.
  static constexpr double kRegion_mm = 25.0;
  [[nodiscard]] Stack clean(const Body &body, const BodyPose &T_device_body,
                            std::span<const Vector3d> region_mm = {}) const;
  // What the local field adds to it.
  [[nodiscard]] image::Image<std::complex<float>, 3> added(const Body &body, const BodyPose &T_device_body,
                                                           const LocalField &local) const;
  // Where the scanner believes that a spin is, and where a spin is that it believes at a place.
  [[nodiscard]] Vector3d believed_mm(const Vector3d &true_mm) const;
  [[nodiscard]] Vector3d true_mm(const Vector3d &believed_mm) const;
  [[nodiscard]] image::Grid<3> grid() const;

private:
  [[nodiscard]] Eigen::Array4f inverse_at(const Vector3d &believed_mm) const;
  void invert() const; // at the first image

  const ScannerField *field_; // must outlive this
  Protocol protocol_;
  StackPlan plan_;
  Vector3d per_Hz_mm_; // movement by B0
  // Minus the displacement, and the change of volume, at nodes of the stack's surroundings.
  mutable std::array<int, 3> nodes_{};
  mutable Vector3d first_mm_;
  mutable std::vector<Eigen::Array4f> inverse_;
};

// The magnitude image of what was received. shift_mm (Device): how far the body has moved since `clean`, far below a
// pixel. added may be null.
[[nodiscard]] Stack received(const Stack &clean, const image::Image<std::complex<float>, 3> *added,
                             const Vector3d &shift_mm, const Appearance &appearance, std::uint64_t shading_seed,
                             Random &noise);

// The stand-in for the vendor's correction: the image at every place as it would be without the gradients' errors,
// looked up in the acquired one through the true field. B0 remains.
[[nodiscard]] Stack vendor_corrected(const Stack &acquired, const ScannerField &field);

} // namespace bregma::sim::scanner
