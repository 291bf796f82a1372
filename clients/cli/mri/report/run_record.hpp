// What a client receives of one registration of a scanner: series of slices, states of the procedure, corrected slices
// and the robot's tool. One thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/image/grid.hpp"
#include "idl/topics.hpp"

namespace bregma::cli::mri_report {

using Stack = image::Image<float, 3>;

struct ReceivedSeries {
  wire::ImageSlice header{};                      // of its first slice, without pixels
  std::vector<std::vector<std::uint16_t>> slices; // by index; empty: not received
  std::vector<Eigen::Vector3d> origins_mm;        // in the scanner

  [[nodiscard]] std::string protocol() const;
  [[nodiscard]] std::size_t received() const;
  [[nodiscard]] bool complete() const { return received() == slices.size(); }
  // T_device_index as T_image_index. Nothing unless it is complete and its slices are apart.
  [[nodiscard]] std::optional<Stack> stack() const;
};

struct CorrectedPicture {
  wire::CorrectedSlice said{}; // without pixels
  std::vector<std::uint16_t> pixels;
};

// A change of the procedure.
struct ProcedureMoment {
  std::int64_t time_ns = 0;
  wire::ScannerStep step = bregma_wire_SCANNER_STEP_UNKNOWN;
  wire::ScannerActivity activity = bregma_wire_SCANNER_ACTIVITY_UNKNOWN;
  std::string text;
};

class RunRecord {
public:
  // At most this many pixels of slices are kept; further series are counted only.
  static constexpr std::size_t kMaxPixels = 200'000'000;

  void add(const wire::ImageSlice &slice); // malformed ones are left out
  void add(const wire::ScannerRegistration &state);
  void add(const wire::CorrectedSlice &slice);
  void add(const wire::RobotTool &tool) { tool_ = tool; }

  [[nodiscard]] const std::vector<ReceivedSeries> &series() const { return series_; }
  [[nodiscard]] const std::vector<ProcedureMoment> &moments() const { return moments_; }
  [[nodiscard]] const std::optional<wire::ScannerRegistration> &state() const { return state_; } // the latest
  [[nodiscard]] const std::vector<CorrectedPicture> &corrected() const { return corrected_; }
  [[nodiscard]] const std::optional<wire::RobotTool> &tool() const { return tool_; }
  [[nodiscard]] std::size_t left_out() const { return left_out_; } // slices: malformed, doubled, too many

  // The complete series of this protocol with most slices; none: nullptr.
  [[nodiscard]] const ReceivedSeries *largest(const std::string &protocol) const;
  // Two complete series of this protocol that follow each other, the first with all coils off, the second with some on.
  struct Pair {
    const ReceivedSeries *background = nullptr, *foreground = nullptr;
  };
  [[nodiscard]] Pair pair_of(const std::string &protocol) const;

private:
  std::vector<ReceivedSeries> series_;
  std::vector<ProcedureMoment> moments_;
  std::optional<wire::ScannerRegistration> state_;
  std::vector<CorrectedPicture> corrected_;
  std::optional<wire::RobotTool> tool_;
  std::size_t pixels_ = 0, left_out_ = 0;
  std::uint64_t frame_ = 0; // of the last slice
};

} // namespace bregma::cli::mri_report
