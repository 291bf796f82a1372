// A simulated session of an MR scanner as the benchmark's estimators see it, and what the truth says about their
// answers.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/coils/robot_registration.hpp"
#include "algorithms/mri/coils/verification.hpp"
#include "algorithms/mri/distortion_field.hpp"
#include "algorithms/mri/separation.hpp"
#include "drivers/sim/scanner/simulated_scanner.hpp"

namespace bregma::bench {

using mri::Rigid3;
using mri::Vector3d;

enum class Images { kVendor, kUncorrected, kOurs };

// Stacks of one scan position.
struct StackPair {
  mri::Stack background, foreground;
  mri::Stack reversed_background, reversed_foreground; // of opposed read-outs
  mri::CoilScan scan;
  Vector3d normal = Vector3d::UnitZ(); // of the slices, in Device
};

// Where the control points of the field come from: found in images of the phantom in CT and MR, or the true crossings,
// displaced at random by the mean errors that their detection may have (0.08 mm in CT, 0.15 mm in MR).
enum class ControlPoints { kDisturbed, kImages };

// Scans with the read-out forward, or forward and reversed with their places averaged, of phantom, coils and target.
enum class ReadOuts { kOne, kOpposed };

class MriSession {
public:
  MriSession(const sim::scanner::ScannerOptions &options, std::uint64_t seed);
  // Another session of the same scanner, with the field that `mapped` has mapped.
  MriSession(const sim::scanner::ScannerOptions &options, std::uint64_t seed, const MriSession &mapped);

  // The field through the phantom's control points. CT and MR points are brought together by least squares, as a rigid
  // registration does. False where no field fits.
  // Opposed read-outs need disturbed control points.
  bool map_field(ControlPoints source = ControlPoints::kDisturbed, ReadOuts read_outs = ReadOuts::kOne);

  // One pair of stacks, or two where the field was mapped with opposed read-outs.
  [[nodiscard]] std::unique_ptr<StackPair> scan(const sim::scanner::Protocol &protocol,
                                                const sim::scanner::StackPlan &plan, const std::vector<std::string> &on,
                                                const std::vector<std::string> &verify = {});
  [[nodiscard]] std::unique_ptr<StackPair> vendor_corrected(const StackPair &pair) const;

  [[nodiscard]] mri::RobotRegistrationOptions options(Images images, mri::CoilMethod method) const;

  // Error of the chain at coils whose own detection is left out: the place at which the scan shows the coil, corrected
  // and mapped, against where the coil really is in Base. mm.
  // kOne: the scan has one read-out, whatever the field was mapped with.
  [[nodiscard]] Vector3d error_at(int coil, const Rigid3<mri::frame::Base, mri::frame::Device> &T_base_device,
                                  Images images, const sim::scanner::Protocol &protocol,
                                  const sim::scanner::StackPlan &plan, ReadOuts read_outs) const;

  [[nodiscard]] sim::scanner::SimulatedScanner &scanner() { return *scanner_; }
  [[nodiscard]] const mri::CoilFrame &frame() const { return frame_; }
  [[nodiscard]] const mri::DistortionField *field() const { return field_.get(); }
  [[nodiscard]] ReadOuts read_outs() const { return read_outs_; }
  [[nodiscard]] std::vector<int> coils_of(const std::vector<std::string> &groups) const;

private:
  struct Pairs {
    geometry::Points3 real, imaged; // real: in the frame of the imaged points
  };
  [[nodiscard]] std::optional<Pairs> disturbed_points() const;
  [[nodiscard]] bool map_opposed();
  // Of a place, the mean over the read-outs.
  [[nodiscard]] Vector3d shown_mm(const Vector3d &real_mm, const sim::scanner::Protocol &protocol,
                                  const sim::scanner::StackPlan &plan, ReadOuts read_outs) const;
  [[nodiscard]] std::optional<Pairs> points_from_images();
  // By the field, or where both parts of it are known and the scan has one read-out, by its gradients and its B0.
  [[nodiscard]] std::optional<mri::CorrectedPoint> corrected(const Vector3d &shown_mm, ReadOuts read_outs) const;

  void name_coils(const sim::scanner::ScannerOptions &options);

  std::unique_ptr<sim::scanner::SimulatedScanner> scanner_;
  std::uint64_t seed_;
  ReadOuts read_outs_ = ReadOuts::kOne;
  sim::scanner::PhantomDesign design_;
  mri::CoilFrame frame_;
  std::shared_ptr<const mri::DistortionField> field_;    // of opposed read-outs: the gradients' part
  std::shared_ptr<const mri::SeparatedField> separated_; // null for one read-out
};

// Stacks of the paper: top or bottom coils in 60 coronal slices; the tree in 60, 100, 120 or 120 slices.
[[nodiscard]] sim::scanner::StackPlan pillar_plan(bool top, int slices = 60);
[[nodiscard]] sim::scanner::StackPlan tree_plan(sim::scanner::Plane plane);

// (7) by plain least squares over all coils, as the paper has it.
[[nodiscard]] std::optional<Rigid3<mri::frame::Base, mri::frame::Device>>
least_squares(const mri::CoilFrame &frame, const std::vector<mri::LocatedCoil> &coils);

} // namespace bregma::bench
