// Registration without a start pose: fewer than three fiducials, and traced skin. A worker searches all poses of the
// head (algorithms/registration/surface/global_surface.hpp) without a time limit. It answers with a pose only if no
// other pose is nearly as likely.
//
// One thread outside the loops, which allocates. Requests and answers are latest values, so no stage waits for it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "algorithms/registration/surface/global_surface.hpp"
#include "server/stages/loaded_case.hpp"

namespace bregma::server {

inline constexpr std::size_t kMaxSearchSamples = 2000;
inline constexpr std::size_t kMinSearchSamples = 60; // with fewer samples the search rarely succeeds

struct PoseSearchRequest {
  std::uint64_t generation = 0; // generation of the case
  std::uint64_t revision = 0;   // revision of the samples
  std::size_t count = 0;
  std::array<std::array<double, 3>, kMaxSearchSamples> reference_mm;
};

struct PoseSearchAnswer {
  std::uint64_t generation = 0;
  std::uint64_t revision = 0;
  bool found = false;
  std::array<double, 4> rotation_wxyz; // T_image_reference, if found
  std::array<double, 3> translation_mm;
  std::array<char, 256> text; // reason of a failure, and the next point to touch; NUL-terminated
};

class PoseSearch {
public:
  PoseSearch();
  ~PoseSearch();

  void handle(const CaseChanged &change);
  // Empty if the request is for another case. The first request of a case prepares the field of the scalp. A search
  // that fails (no memory) gives an answer without a pose.
  [[nodiscard]] std::optional<PoseSearchAnswer> answer(const PoseSearchRequest &request) noexcept;

private:
  struct Prepared;
  void search(const PoseSearchRequest &request, PoseSearchAnswer &out);
  LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::unique_ptr<Prepared> prepared_; // for the current case
};

} // namespace bregma::server
