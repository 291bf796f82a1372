// The distortion of scans, each with its own read-out.
//
// The gradients displace a spin alike in every scan, B0 by B0 d: d is the movement per Hz of the scan (separation.hpp).
// A field from one scan of a phantom holds both parts, of its own read-out. Where both parts are known, from opposed
// read-outs, the field of every scan follows from them, whatever its read-out, pixel and bandwidth.
//
// Units: mm, Hz; the frame is that of the field. const members are thread-safe.
#pragma once

#include <memory>

#include <Eigen/Core>

#include "algorithms/mri/field_table.hpp"
#include "algorithms/mri/separation.hpp"

namespace bregma::mri {

class ScanFields {
public:
  // Of one read-out: the same table for every scan. mm_per_Hz: of the scan that measured it; zero: not known.
  explicit ScanFields(std::shared_ptr<const FieldTable> of_one_read_out,
                      const Eigen::Vector3d &mm_per_Hz = Eigen::Vector3d::Zero());
  // Both parts: that of the gradients, and the displacement by B0 in a scan with this mm_per_Hz. Their grids must be
  // the same and mm_per_Hz not zero; otherwise std::invalid_argument.
  ScanFields(std::shared_ptr<const FieldTable> gradients, std::shared_ptr<const FieldTable> by_b0,
             const Eigen::Vector3d &mm_per_Hz);
  // As FieldTable makes it.
  ScanFields(const SeparatedField &field, const Eigen::Vector3d &mm_per_Hz, double spacing_mm = 4.0,
             double margin_mm = 24.0, int threads = 1);

  [[nodiscard]] bool has_b0() const { return b0_ != nullptr; }
  // The part of the gradients where that of B0 is known, otherwise the field of one read-out.
  [[nodiscard]] const std::shared_ptr<const FieldTable> &table() const { return table_; }
  [[nodiscard]] const std::shared_ptr<const FieldTable> &by_b0() const { return b0_; } // null: not known
  [[nodiscard]] const Eigen::Vector3d &mm_per_Hz() const { return mm_per_Hz_; }

  // The field of a scan that B0 displaces by mm_per_Hz, with the stated error of both parts; table() where B0 is not
  // known. Milliseconds, allocates.
  [[nodiscard]] std::shared_ptr<const FieldTable> of_scan(const Eigen::Vector3d &mm_per_Hz) const;
  // A field of one read-out, and a scan with the opposite one: its part of B0 would double what it is to correct. False
  // where one of them is not stated.
  [[nodiscard]] bool is_opposite(const Eigen::Vector3d &mm_per_Hz) const;
  // 0 where B0 is not known.
  [[nodiscard]] double b0_Hz(const Eigen::Vector3d &true_mm) const noexcept;

private:
  std::shared_ptr<const FieldTable> table_, b0_;
  Eigen::Vector3d mm_per_Hz_;
};

} // namespace bregma::mri
