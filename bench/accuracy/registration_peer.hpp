// The peer of local registration: the Point Cloud Library's point-to-plane ICP onto the same vertices, its tree
// prebuilt.
#pragma once

#include <memory>
#include <span>

#include "bench/accuracy/registration_head.hpp"

namespace bregma::bench {

class PclIcp {
public:
  explicit PclIcp(const Head &head);
  ~PclIcp();
  PclIcp(PclIcp &&) noexcept;
  PclIcp &operator=(PclIcp &&) noexcept;
  // False if the program was built without the library.
  [[nodiscard]] static bool available();
  [[nodiscard]] PairedPose fit(std::span<const Vector3d> source_mm, const PairedPose &start);

private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

} // namespace bregma::bench
