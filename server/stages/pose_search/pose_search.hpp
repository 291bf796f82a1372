// The recovery of the registration where there is no start pose: fewer than three fiducials, and skin that was traced.
// A worker searches all poses of the head (algorithms/registration/surface/global_surface.hpp), takes as long as that
// needs, and answers with a pose only when no other is nearly as likely.
//
// One thread, which is no loop: it allocates. Requests and answers pass through latest values, so nothing waits for it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "algorithms/registration/surface/global_surface.hpp"
#include "server/stages/loaded_case.hpp"

namespace bregma::server {

inline constexpr std::size_t kMaxSearchSamples = 2000;
inline constexpr std::size_t kMinSearchSamples = 60; // fewer are found too seldom to be worth the wait

struct PoseSearchRequest {
  std::uint64_t generation = 0; // of the case
  std::uint64_t revision = 0;   // of the samples
  std::size_t count = 0;
  std::array<std::array<double, 3>, kMaxSearchSamples> reference_mm;
};

struct PoseSearchAnswer {
  std::uint64_t generation = 0;
  std::uint64_t revision = 0;
  bool found = false;
  std::array<double, 4> rotation_wxyz; // T_image_reference, when found
  std::array<double, 3> translation_mm;
  std::array<char, 256> text; // why not, and where to touch next; NUL-terminated
};

class PoseSearch {
public:
  PoseSearch();
  ~PoseSearch();

  void handle(const CaseChanged &change);
  // Nothing when the request is for another case. The field of the scalp is prepared for the first request of a case. A
  // search that fails (no memory) is an answer without a pose.
  [[nodiscard]] std::optional<PoseSearchAnswer> answer(const PoseSearchRequest &request) noexcept;

private:
  struct Prepared;
  void search(const PoseSearchRequest &request, PoseSearchAnswer &out);
  LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::unique_ptr<Prepared> prepared_; // of the present case
};

} // namespace bregma::server
