#include "server/stages/scanner/coil_scans.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "casefile/coil_frames.hpp"
#include "server/session/session_text.hpp"
#include "server/stages/scanner/slice_guard.hpp"

namespace bregma::server {

namespace {

constexpr double kSamePlane_mm = 0.05;
constexpr double kSameReadOut = 0.01; // relative, of movements by B0
constexpr double kTable_mm = 0.5;     // a larger change of the table's position is a movement

} // namespace

base::Result<std::vector<int>> coils_of_pattern(const mri::CoilFrame &frame, const std::string &pattern) {
  const auto mask = casefile::coils_of(frame, pattern);
  if (!mask) {
    return base::failure(mask.error());
  }
  std::vector<int> out;
  for (std::size_t i = 0; i < frame.coils.size(); ++i) {
    if ((*mask >> i & 1U) != 0) {
      out.push_back(static_cast<int>(i));
    }
  }
  return out;
}

bool table_moved(const std::optional<double> &from_mm, const std::optional<double> &to_mm) {
  return from_mm && to_mm && std::abs(*from_mm - *to_mm) > kTable_mm;
}

std::optional<double> stated_table(const wire::ImageSlice &slice) {
  return slice.table_stated ? std::optional<double>(slice.table_mm) : std::nullopt;
}

std::optional<mri::PatientPosition> stated_position(const wire::ImageSlice &slice) {
  if (slice.patient_position < bregma_wire_POSITION_HFS || slice.patient_position > bregma_wire_POSITION_FFDL) {
    return std::nullopt;
  }
  return static_cast<mri::PatientPosition>(slice.patient_position - bregma_wire_POSITION_HFS);
}

base::Result<void> CoilPair::set_background(const SliceStack &slices, const wire::ImageSlice &header) {
  auto stack = slices.stack();
  if (!stack) {
    return base::failure(name_ + ", background: " + stack.error());
  }
  if (header.coil_state > bregma_wire_COILS_OFF) {
    return base::failure(name_ + ", background: the scanner states that coils carried current");
  }
  foreground_.reset();
  finder_.reset();
  artefacts_.clear();
  background_ = std::make_unique<mri::Stack>(std::move(*stack));
  auto finder = mri::ArtefactFinder::start(*background_);
  if (!finder) {
    return base::failure(name_ + ": " + finder.error());
  }
  finder_.emplace(std::move(*finder));
  table_mm_ = stated_table(header);
  position_ = stated_position(header).value_or(mri::PatientPosition::kHfs);
  mm_per_Hz_ = movement_by_b0(header);
  return {};
}

base::Result<void> CoilPair::add(const SliceStack &slices, std::uint32_t index, const wire::ImageSlice &header) {
  if (!finder_ || foreground_) {
    return base::failure(name_ + ": its background is missing");
  }
  const mri::Stack &back = *background_;
  const Eigen::Vector3d expected = back.point_mm(Eigen::Vector3d(0.0, 0.0, index));
  const Eigen::Matrix3d &axes = slices.axes();
  if (slices.expected() != static_cast<std::uint32_t>(back.size[2]) ||
      slices.slice(index).size() != static_cast<std::size_t>(back.size[0]) * static_cast<std::size_t>(back.size[1]) ||
      std::abs(header.spacing_mm[0] - back.axes().col(0).norm()) > 1e-3 ||
      (axes.col(0) - back.axes().col(0).normalized()).norm() > kSameDirection ||
      (axes.col(1) - back.axes().col(1).normalized()).norm() > kSameDirection) {
    return base::failure(name_ + ": the foreground has another orientation or size than the background");
  }
  if ((slices.origin_mm(index) - expected).norm() > kSamePlane_mm) {
    return base::failure(name_ + ": slice " + std::to_string(index + 1) + " of the foreground lies " +
                         mm((slices.origin_mm(index) - expected).norm()) + " from that of the background");
  }
  if (table_moved(table_mm_, stated_table(header))) {
    return base::failure(name_ + ": the table moved between background and foreground");
  }
  if ((movement_by_b0(header) - mm_per_Hz_).norm() > kSameReadOut * mm_per_Hz_.norm()) {
    return base::failure(name_ + ": the foreground has another read-out or bandwidth than the background");
  }
  if (header.coil_state == bregma_wire_COILS_OFF) {
    return base::failure(name_ + ": the scanner states that no coil carried current in the foreground");
  }
  if (header.coils_on != 0) {
    std::uint64_t wanted = 0;
    for (const int coil : on_) {
      wanted |= std::uint64_t{1} << static_cast<unsigned>(coil);
    }
    if (header.coils_on != wanted) {
      return base::failure(name_ + ": the scanner states other coils than were switched on");
    }
  }
  (void)finder_->add(static_cast<int>(index), slices.slice(index)); // its size was compared above
  return {};
}

base::Result<void> CoilPair::finish(const SliceStack &foreground) {
  auto stack = foreground.stack();
  if (!stack) {
    return base::failure(name_ + ", foreground: " + stack.error());
  }
  auto found = finder_->finish();
  if (!found) {
    return base::failure(name_ + ": " + found.error());
  }
  artefacts_ = std::move(found->artefacts);
  foreground_ = std::make_unique<mri::Stack>(std::move(*stack));
  return {};
}

mri::CoilScan CoilPair::scan() const {
  mri::CoilScan out;
  out.name = name_;
  out.background = background_.get();
  out.foreground = foreground_.get();
  out.on = on_;
  return out;
}

bool are_opposed(const Eigen::Vector3d &mm_per_Hz, const Eigen::Vector3d &other_mm_per_Hz) {
  return !mm_per_Hz.isZero() && (mm_per_Hz + other_mm_per_Hz).norm() < kSameReadOut * mm_per_Hz.norm();
}

CoilScans::CoilScans(const std::string &name, const std::vector<int> &on, bool opposed) : forward_(name, on) {
  if (opposed) {
    reversed_.emplace(name + ", read-out reversed", on);
  }
}

base::Result<void> CoilScans::set_background(bool reversed, const SliceStack &slices, const wire::ImageSlice &header) {
  if (reversed && !are_opposed(forward_.mm_per_Hz(), movement_by_b0(header))) {
    return base::failure("the scanner does not state opposed read-outs, with the same bandwidth, for protocols " +
                         wire::text(header.protocol) + " and that without the suffix");
  }
  if (reversed && table_moved(forward_.table_mm(), stated_table(header))) {
    return base::failure("the table moved between the scans with both read-outs");
  }
  return pair(reversed).set_background(slices, header);
}

mri::CoilScan CoilScans::scan() const {
  mri::CoilScan out = forward_.scan();
  if (reversed_) {
    const mri::CoilScan reversed = reversed_->scan();
    out.reversed_background = reversed.background;
    out.reversed_foreground = reversed.foreground;
  }
  return out;
}

std::vector<mri::CoilArtefact> CoilScans::artefacts() const {
  return reversed_
             ? mri::mean_of_read_outs(forward_.artefacts(), reversed_->artefacts(), mri::ArtefactOptions{}.window_mm)
             : forward_.artefacts();
}

VerifyingCoils verify(const mri::CoilFrame &frame, const CoilScans &scans,
                      const geometry::UncertainPose<mri::frame::Base, mri::frame::Device> &T_base_device,
                      std::span<const mri::LocatedCoil> fitted, const mri::RobotRegistrationOptions &options) {
  VerifyingCoils out;
  mri::RobotRegistration registration;
  registration.T_base_device = T_base_device;
  const mri::CoilScan scan = scans.scan();
  auto located = mri::locate_targets(frame, scan, registration, options);
  if (!located) {
    out.found.failure = located.error();
    return out;
  }
  out.coils = std::move(*located);
  out.found = mri::verify_registration(frame, out.coils, scan.on.size(), T_base_device, fitted,
                                       mri::unit_axes(*scan.background), options);
  out.b0 = mri::b0_change(out.coils, {}, T_base_device.pose, options.mapped_b0);
  return out;
}

} // namespace bregma::server
