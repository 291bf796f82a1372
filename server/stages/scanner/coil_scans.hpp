// The coil scans of a registration, and the registration by them. A foreground is worked out slice by slice as it comes
// (mri::ArtefactFinder), so that little is left after its last slice.
//
// Units: mm. One thread.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/mri/coils/robot_registration.hpp"
#include "algorithms/mri/coils/verification.hpp"
#include "base/result.hpp"
#include "server/stages/scanner/slice_stack.hpp"

namespace bregma::server {

// Indices of the coils of a pattern (casefile/coil_frames.hpp).
[[nodiscard]] base::Result<std::vector<int>> coils_of_pattern(const mri::CoilFrame &frame, const std::string &pattern);

// Background and foreground of one position of the stack.
class CoilPair {
public:
  CoilPair(std::string name, std::vector<int> on) : name_(std::move(name)), on_(std::move(on)) {}

  // Refused: a background without signal, saturated, or not at equal steps.
  [[nodiscard]] base::Result<void> set_background(const SliceStack &slices, const wire::ImageSlice &header);
  // Slice `index` (from 0) of the foreground as it comes. Refused: another plane, size or table position than that of
  // the background, coils in another state than they should be.
  [[nodiscard]] base::Result<void> add(const SliceStack &slices, std::uint32_t index, const wire::ImageSlice &header);
  // After the last slice.
  [[nodiscard]] base::Result<void> finish(const SliceStack &foreground);

  [[nodiscard]] bool finished() const { return foreground_ != nullptr; }
  [[nodiscard]] mri::CoilScan scan() const;
  [[nodiscard]] const std::vector<mri::CoilArtefact> &artefacts() const { return artefacts_; }
  [[nodiscard]] std::optional<double> table_mm() const { return table_mm_; }
  [[nodiscard]] mri::PatientPosition position() const { return position_; }
  // Of the background (slice_stack.hpp).
  [[nodiscard]] const Eigen::Vector3d &mm_per_Hz() const { return mm_per_Hz_; }

private:
  std::string name_;
  std::vector<int> on_;
  std::unique_ptr<mri::Stack> background_, foreground_;
  std::optional<mri::ArtefactFinder> finder_;
  std::vector<mri::CoilArtefact> artefacts_;
  std::optional<double> table_mm_; // as stated
  mri::PatientPosition position_ = mri::PatientPosition::kHfs;
  Eigen::Vector3d mm_per_Hz_ = Eigen::Vector3d::Zero();
};

// The scans of one position of the stack: with one read-out, or with opposed ones.
class CoilScans {
public:
  CoilScans(const std::string &name, const std::vector<int> &on, bool opposed);

  // reversed: with the read-out reversed; only where they are opposed, and after the forward one.
  [[nodiscard]] CoilPair &pair(bool reversed) { return reversed ? *reversed_ : forward_; }
  // As CoilPair. Also refused: a read-out that is not opposed to the other one, a table that moved between both.
  [[nodiscard]] base::Result<void> set_background(bool reversed, const SliceStack &slices,
                                                  const wire::ImageSlice &header);

  [[nodiscard]] bool finished() const { return forward_.finished() && (!reversed_ || reversed_->finished()); }
  [[nodiscard]] bool opposed() const { return reversed_.has_value(); }
  [[nodiscard]] mri::CoilScan scan() const;
  [[nodiscard]] std::vector<mri::CoilArtefact> artefacts() const; // of opposed read-outs the mean
  [[nodiscard]] std::optional<double> table_mm() const { return forward_.table_mm(); }
  [[nodiscard]] mri::PatientPosition position() const { return forward_.position(); }
  [[nodiscard]] const Eigen::Vector3d &mm_per_Hz() const { return forward_.mm_per_Hz(); }

private:
  CoilPair forward_;
  std::optional<CoilPair> reversed_;
};

// Whether B0 displaces two scans oppositely along one line; false where one of them does not state its read-out.
[[nodiscard]] bool are_opposed(const Eigen::Vector3d &mm_per_Hz, const Eigen::Vector3d &other_mm_per_Hz);

// The table positions of two scans or slices differ by more than a registration allows. False where one is not stated.
[[nodiscard]] bool table_moved(const std::optional<double> &from_mm, const std::optional<double> &to_mm);
[[nodiscard]] std::optional<double> stated_table(const wire::ImageSlice &slice);
// Nothing for a position that is not stated or not known here.
[[nodiscard]] std::optional<mri::PatientPosition> stated_position(const wire::ImageSlice &slice);

// Coils that verify a registration, compared with where it expects them (mri::verify_registration). fitted: those of
// its fit; may be empty.
struct VerifyingCoils {
  std::vector<mri::LocatedCoil> coils;
  mri::Verification found;
  mri::B0Change b0; // of coils that opposed read-outs show
};
[[nodiscard]] VerifyingCoils verify(const mri::CoilFrame &frame, const CoilScans &scans,
                                    const geometry::UncertainPose<mri::frame::Base, mri::frame::Device> &T_base_device,
                                    std::span<const mri::LocatedCoil> fitted,
                                    const mri::RobotRegistrationOptions &options);

} // namespace bregma::server
