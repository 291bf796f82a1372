// Reproduces PLUS' registration of a phantom from its recording of a stylus that pivots on eight landmarks.
#include <algorithm>
#include <cmath>
#include <regex>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "algorithms/registration/points/paired_points.hpp"
#include "casefile/poses.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using bregma::casefile::NamedRigid;
using Eigen::Vector3d;

// PLUS detects a landmark if the tip rests while the shaft moves. The tip, averaged over windows of 0.2 s, stays in a
// box with a diagonal of 1.5 mm for 1 s, while a point 100 mm up the shaft leaves a box of 30 mm. The landmark is the
// mean of the second to the fifth frame of the touch.
constexpr double kFrameRate_hz = 15.0;
constexpr std::size_t kWindow = 3; // 0.2 s
constexpr std::size_t kWindows = 5;
constexpr std::ptrdiff_t kAveragedFrom = 1;
constexpr std::ptrdiff_t kAveragedTo = 5;
constexpr double kTipRests_mm = 1.5;
constexpr double kShaftMoves_mm = 30.0;
constexpr double kSameLandmark_mm = 5.0;
const Vector3d kShaft(100.0, 0.0, 0.0); // in StylusTip

std::vector<Vector3d> find_landmarks(const std::vector<NamedRigid> &T_reference_tip) {
  std::vector<Vector3d> found;
  std::vector<Vector3d> tips;
  Eigen::AlignedBox3d tip_box;
  Eigen::AlignedBox3d shaft_box;
  const auto start_anew = [&] {
    tips.clear();
    tip_box.setEmpty();
    shaft_box.setEmpty();
  };
  const auto mean = [](auto begin, auto end) {
    Vector3d sum = Vector3d::Zero();
    std::for_each(begin, end, [&sum](const Vector3d &p) { sum += p; });
    return Vector3d(sum / static_cast<double>(end - begin));
  };
  for (const NamedRigid &T : T_reference_tip) {
    tips.push_back(T.translation());
    if (tips.size() % kWindow != 0) {
      continue;
    }
    tip_box.extend(mean(tips.end() - kWindow, tips.end()));
    shaft_box.extend(T * kShaft);
    if (tip_box.diagonal().norm() > kTipRests_mm) {
      start_anew();
      continue;
    }
    if (tips.size() < kWindow * kWindows || shaft_box.diagonal().norm() < kShaftMoves_mm) {
      continue;
    }
    const Vector3d landmark = mean(tips.begin() + kAveragedFrom, tips.begin() + kAveragedTo);
    const bool known = std::any_of(found.begin(), found.end(),
                                   [&](const Vector3d &other) { return (other - landmark).norm() < kSameLandmark_mm; });
    if (!known) {
      found.push_back(landmark);
    }
    start_anew();
  }
  return found;
}

std::vector<double> numbers_in(const std::string &text) {
  std::vector<double> out;
  const std::regex number(R"([-+]?[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?)");
  for (std::sregex_iterator it(text.begin(), text.end(), number), end; it != end; ++it) {
    out.push_back(std::stod(it->str()));
  }
  return out;
}

struct PlusTransform {
  NamedRigid pose;
  double error = 0.0;
};

PlusTransform transform_in(const std::string &xml, const std::string &from, const std::string &to) {
  const std::regex pattern("From=\"" + from + "\"\\s+To=\"" + to + "\"\\s+Matrix=\"([^\"]*)\"\\s+Error=\"([^\"]*)\"");
  std::smatch match;
  if (!std::regex_search(xml, match, pattern)) {
    throw std::runtime_error("no transform " + from + " to " + to);
  }
  const auto n = numbers_in(match[1]);
  Eigen::Matrix3d R;
  R << n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10];
  return {NamedRigid(R, Vector3d(n[3], n[7], n[11])), std::stod(match[2])};
}

std::vector<Vector3d> landmarks_in(const std::string &xml) {
  std::vector<Vector3d> out;
  const std::regex pattern("<Landmark Name=\"[^\"]*\" Position=\"([^\"]*)\"");
  for (std::sregex_iterator it(xml.begin(), xml.end(), pattern), end; it != end; ++it) {
    const auto n = numbers_in((*it)[1]);
    out.emplace_back(n[0], n[1], n[2]);
  }
  return out;
}

TEST(Phantom, RegistrationOfPlusIsReproducedFromTheRecording) {
  BREGMA_SHARED_DATA(folder, "tracker/plus");
  const std::string devices = bregma::tests::read_file(folder / "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml");
  const std::string results = bregma::tests::read_file(folder / "PhantomRegistrationLandmarkDetection.results.xml");
  const auto sequence =
      bregma::casefile::read_transform_sequence(folder / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha");
  ASSERT_TRUE(sequence) << sequence.error().message;
  const auto stylus = sequence->series("StylusToReference");
  ASSERT_TRUE(stylus) << stylus.error().message;
  ASSERT_EQ(stylus->poses.size(), 1000U);
  const double seconds = 1e-9 * static_cast<double>(stylus->poses.back().time_ns - stylus->poses.front().time_ns);
  EXPECT_NEAR(999.0 / seconds, kFrameRate_hz, 0.1);

  // The device set contains the calibration of the recorded stylus; the results file contains that of another day.
  const NamedRigid T_stylus_tip = transform_in(devices, "StylusTip", "Stylus").pose;
  std::vector<NamedRigid> T_reference_tip;
  for (const auto &pose : stylus->poses) {
    using bregma::geometry::frame::Source;
    using bregma::geometry::frame::Target;
    using bregma::geometry::frame::Tool;
    T_reference_tip.push_back(pose.pose.as<Target, Tool>() * T_stylus_tip.as<Tool, Source>());
  }
  const auto touched = find_landmarks(T_reference_tip);
  const auto landmarks = landmarks_in(devices);
  ASSERT_EQ(landmarks.size(), 8U);
  ASSERT_EQ(touched.size(), 8U);

  const auto T_reference_phantom = bregma::registration::fit_rigid(landmarks, touched);
  ASSERT_TRUE(T_reference_phantom);
  const PlusTransform published = transform_in(results, "Phantom", "Reference");
  const double stylus_error = transform_in(results, "StylusTip", "Stylus").error;
  double mean = 0.0;
  double squares = 0.0;
  double farthest = 0.0;
  for (std::size_t i = 0; i < 8; ++i) {
    const double error = (*T_reference_phantom * landmarks[i] - touched[i]).norm();
    mean += error / 8.0;
    squares += error * error / 8.0;
    farthest = std::max(farthest, (*T_reference_phantom * landmarks[i] - published.pose * landmarks[i]).norm());
  }
  const double turned = bregma::geometry::angle_between(T_reference_phantom->rotation(), published.pose.rotation());
  const Vector3d t = T_reference_phantom->translation();
  std::printf("phantom to reference: translation (%.3f, %.3f, %.3f), published (%.3f, %.3f, %.3f), %.2f degrees apart; "
              "landmarks at most %.3f mm from where the published transform puts them\nerror: mean %.3f, RMS %.3f mm, "
              "published %.3f mm (stylus tip error %.3f mm)\n",
              t.x(), t.y(), t.z(), published.pose.translation().x(), published.pose.translation().y(),
              published.pose.translation().z(), turned * 57.29578, farthest, mean, std::sqrt(squares), published.error,
              stylus_error);
  EXPECT_NEAR(mean, published.error, 0.015);
  // PLUS replayed the recording in real time, so the first frame of its first window is unknown. The tolerance is about
  // the effect of a shift by one frame.
  EXPECT_LT(farthest, 0.15);
  EXPECT_LT(turned, 0.003);
}

} // namespace
