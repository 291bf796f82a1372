#include "clients/cli/mri/report/run_record.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include <Eigen/Geometry>

#include "idl/names.hpp"

namespace bregma::cli::mri_report {

namespace {

constexpr std::uint32_t kMaxSlices = 512;    // of a series, as the daemon allows
constexpr double kApart_mm = 1e-3;           // slices that are nearer lie in one plane
constexpr std::size_t kMaxCorrected = 1'000; // of the newest

Eigen::Matrix3d axes_of(const wire::ImageSlice &slice) {
  const auto &q = slice.T_scanner_slice.rotation_wxyz;
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

bool is_whole(const wire::ImageSlice &slice) {
  return slice.columns > 0 && slice.rows > 0 && slice.pixels._buffer != nullptr &&
         std::uint64_t{slice.columns} * slice.rows == slice.pixels._length && slice.count > 0 &&
         slice.count <= kMaxSlices && slice.index > 0 && slice.index <= slice.count;
}

} // namespace

std::string ReceivedSeries::protocol() const { return wire::text(header.protocol); }

std::size_t ReceivedSeries::received() const {
  return static_cast<std::size_t>(
      std::count_if(slices.begin(), slices.end(), [](const auto &pixels) { return !pixels.empty(); }));
}

std::optional<Stack> ReceivedSeries::stack() const {
  if (!complete()) {
    return std::nullopt;
  }
  const Eigen::Matrix3d axes = axes_of(header);
  const auto count = static_cast<int>(slices.size());
  const Eigen::Vector3d step = count > 1 ? Eigen::Vector3d((origins_mm.back() - origins_mm.front()) / (count - 1))
                                         : Eigen::Vector3d(std::max(header.thickness_mm, 1.0) * axes.col(2));
  if (std::abs(step.dot(axes.col(2))) < kApart_mm) {
    return std::nullopt;
  }
  Stack out;
  out.size = {static_cast<int>(header.columns), static_cast<int>(header.rows), count};
  out.T_image_index.topLeftCorner<3, 3>() << axes.col(0) * header.spacing_mm[0], axes.col(1) * header.spacing_mm[1],
      step;
  out.T_image_index.topRightCorner<3, 1>() = origins_mm.front();
  out.voxels.reserve(out.pixels());
  for (const auto &pixels : slices) {
    out.voxels.insert(out.voxels.end(), pixels.begin(), pixels.end());
  }
  return out;
}

void RunRecord::add(const wire::ImageSlice &slice) {
  if (!is_whole(slice) || pixels_ + slice.pixels._length > kMaxPixels) {
    ++left_out_;
    return;
  }
  // A scanner that is started again counts slices and series anew.
  const bool restarted = slice.frame < std::exchange(frame_, slice.frame);
  if (series_.empty() || restarted || series_.back().header.series != slice.series) {
    ReceivedSeries series;
    series.header = slice;
    series.header.pixels = {};
    series.slices.resize(slice.count);
    series.origins_mm.resize(slice.count, Eigen::Vector3d::Zero());
    series_.push_back(std::move(series));
  }
  ReceivedSeries &series = series_.back();
  if (slice.index > series.slices.size() || slice.columns != series.header.columns ||
      slice.rows != series.header.rows || !series.slices[slice.index - 1].empty()) {
    ++left_out_;
    return;
  }
  series.slices[slice.index - 1].assign(slice.pixels._buffer, slice.pixels._buffer + slice.pixels._length);
  series.origins_mm[slice.index - 1] = Eigen::Vector3d::Map(slice.T_scanner_slice.translation_mm);
  pixels_ += slice.pixels._length;
}

void RunRecord::add(const wire::ScannerRegistration &state) {
  if (!state_ || state_->step != state.step || state_->activity != state.activity) {
    moments_.push_back(
        {state.time_ns, state.step, state.activity, std::string(state.text, strnlen(state.text, sizeof state.text))});
  }
  state_ = state;
}

void RunRecord::add(const wire::CorrectedSlice &slice) {
  if (!is_whole(slice.slice)) {
    ++left_out_;
    return;
  }
  CorrectedPicture picture;
  picture.said = slice;
  picture.said.slice.pixels = {};
  picture.pixels.assign(slice.slice.pixels._buffer, slice.slice.pixels._buffer + slice.slice.pixels._length);
  // A slice that is published again, with more neighbours, replaces the former.
  const auto same = std::find_if(corrected_.begin(), corrected_.end(), [&](const CorrectedPicture &other) {
    return other.said.slice.series == slice.slice.series && other.said.slice.index == slice.slice.index;
  });
  if (same != corrected_.end()) {
    *same = std::move(picture);
  } else {
    if (corrected_.size() >= kMaxCorrected) {
      corrected_.erase(corrected_.begin());
      ++left_out_;
    }
    corrected_.push_back(std::move(picture));
  }
}

const ReceivedSeries *RunRecord::largest(const std::string &protocol) const {
  const ReceivedSeries *out = nullptr;
  for (const ReceivedSeries &series : series_) {
    if (series.protocol() == protocol && series.complete() &&
        (out == nullptr || series.slices.size() >= out->slices.size())) {
      out = &series;
    }
  }
  return out;
}

RunRecord::Pair RunRecord::pair_of(const std::string &protocol) const {
  Pair out, last;
  for (const ReceivedSeries &series : series_) {
    if (series.protocol() != protocol || !series.complete()) {
      continue;
    }
    if (series.header.coils_on == 0) {
      last = {&series, nullptr};
    } else if (last.background != nullptr && last.background->slices.size() == series.slices.size()) {
      out = {last.background, &series};
    }
  }
  return out;
}

} // namespace bregma::cli::mri_report
