// The simulated scanner against closed forms: fields, where spins appear, brightness, noise, coils and bubbles.
#include <gtest/gtest.h>

#include <cmath>

#include "drivers/sim/scanner/loop_field.hpp"
#include "drivers/sim/scanner/simulated_scanner.hpp"

namespace bregma::sim::scanner::test {

namespace {

// A ball of water in plastic.
class Ball final : public Body {
public:
  Ball(const Vector3d &centre_mm, double radius_mm)
      : Body(Vector3d::Constant(150.0)), centre_mm_(centre_mm), radius_mm_(radius_mm) {}
  [[nodiscard]] double plastic(const Vector3d &p_mm, double ramp_mm) const override {
    return 1.0 - inside((p_mm - centre_mm_).norm(), radius_mm_, ramp_mm);
  }

private:
  Vector3d centre_mm_;
  double radius_mm_;
};

struct Moment {
  double volume_mm3 = 0.0;
  Vector3d centre_mm = Vector3d::Zero();
};
Moment moment(const Stack &image, double unit) {
  Moment out;
  const double voxel = std::abs(image.axes().determinant());
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    const double part = static_cast<double>(image.voxels[i]) / unit * voxel;
    out.volume_mm3 += part;
    out.centre_mm += part * image.pixel_mm(i);
  }
  out.centre_mm /= out.volume_mm3;
  return out;
}

// Weighted centre of the signal that the current took away, within 12 mm of a place.
Vector3d artefact_centre(const Stack &background, const Stack &foreground, const Vector3d &near_mm) {
  double sum = 0.0;
  Vector3d centre = Vector3d::Zero();
  for (std::size_t i = 0; i < background.voxels.size(); ++i) {
    const Vector3d at = background.pixel_mm(i);
    const double lost = static_cast<double>(background.voxels[i] - foreground.voxels[i]);
    if ((at - near_mm).norm() < 12.0) {
      sum += lost;
      centre += lost * at;
    }
  }
  return centre / sum;
}

ScannerOptions quiet() {
  ScannerOptions out;
  out.appearance.snr = 0.0;
  out.appearance.shading = 0.0;
  out.errors.drift_mm = 0.0;
  return out;
}

} // namespace

TEST(LoopField, OnTheAxisIsTheClosedForm) {
  for (const double z : {0.0, 1.0, 4.0, 20.0}) {
    const double a = 2.5e-3, along = z * 1e-3;
    const double expected = 4e-7 * M_PI * 0.075 * a * a / (2.0 * std::pow(a * a + along * along, 1.5));
    EXPECT_NEAR(loop_field(2.5, 0.075, 0.0, z).along_T / expected, 1.0, 1e-9) << z;
  }
}

TEST(LoopField, FarAwayItIsADipole) {
  const CoilField coil({2.5, 2.5, 20}, 40.0);
  const double moment = 20 * M_PI * 2.5e-3 * 2.5e-3; // per ampere
  const Vector3d axis = Vector3d(0.3, 0.9, -0.2).normalized();
  for (const Vector3d &d : {Vector3d(20, 5, 3), Vector3d(-4, 25, 6), Vector3d(8, -3, -22)}) {
    const Vector3d r = d * 1e-3;
    const Vector3d u = r.normalized();
    const Vector3d expected = 1e-7 * moment * (3.0 * axis.dot(u) * u - axis) / std::pow(r.norm(), 3);
    EXPECT_LT((coil(d, axis) - expected).norm(), 0.03 * expected.norm()) << d.transpose();
  }
}

TEST(ScannerField, ItsHarmonicsSolveLaplacesEquation) {
  const Vector3d at(40, -25, 60);
  const double h = 0.5;
  const std::vector<double> middle = solid_harmonics(at, 150.0, 2, 7);
  ASSERT_EQ(middle.size(), 60U);
  std::vector<double> laplacian(middle.size(), 0.0), scale(middle.size(), 0.0);
  for (int d = 0; d < 3; ++d) {
    const auto up = solid_harmonics(at + h * Vector3d::Unit(d), 150.0, 2, 7);
    const auto down = solid_harmonics(at - h * Vector3d::Unit(d), 150.0, 2, 7);
    for (std::size_t i = 0; i < middle.size(); ++i) {
      laplacian[i] += (up[i] + down[i] - 2.0 * middle[i]) / (h * h);
      scale[i] += std::abs(up[i] + down[i] - 2.0 * middle[i]) / (h * h);
    }
  }
  for (std::size_t i = 0; i < middle.size(); ++i) {
    EXPECT_LE(std::abs(laplacian[i]), 1e-3 * scale[i] + 1e-9) << i;
  }
}

TEST(ScannerField, IsAsLargeAsAskedFor) {
  const std::vector<Vector3d> sample = Phantom({}).crossings_mm();
  ASSERT_EQ(sample.size(), 1331U);
  for (const FieldKind kind : {FieldKind::kHarmonics, FieldKind::kBumps}) {
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      FieldOptions options;
      options.kind = kind;
      const ScannerField field(options, sample, seed);
      const ScannerField::Distortion d = field.distortion(sample);
      EXPECT_NEAR(d.mean_mm, 1.20, 0.02) << seed;
      EXPECT_GT(d.max_mm, 2.8) << seed;
      EXPECT_LT(d.max_mm, 5.5) << seed;
    }
  }
}

TEST(Acquisition, ABallAppearsWhereTheFieldPutsItWithItsSignalKept) {
  FieldOptions options;
  options.b0_Hz = 80.0;
  const ScannerField field(options, Phantom({}).crossings_mm(), 4);
  const Vector3d place(55, -40, 48);
  const Ball ball(place, 9.0);
  for (const Plane plane : {Plane::kCoronal, Plane::kSagittal, Plane::kTransverse, Plane::kDoubleOblique}) {
    Protocol protocol = coil_protocol(60);
    const StackPlan plan = plan_of(plane, place, 24);
    const Acquisition acquisition(field, protocol, plan);
    const Moment m = moment(acquisition.clean(ball, BodyPose()), 1.0);
    // The mean over the ball of where its spins are believed to be.
    Vector3d expected = Vector3d::Zero();
    int n = 0;
    for (double x = -9; x <= 9; x += 1.5) {
      for (double y = -9; y <= 9; y += 1.5) {
        for (double z = -9; z <= 9; z += 1.5) {
          if (Vector3d(x, y, z).norm() < 9.0) {
            expected += acquisition.believed_mm(place + Vector3d(x, y, z));
            ++n;
          }
        }
      }
    }
    expected /= n;
    EXPECT_GT((expected - place).norm(), 0.3) << name(plane); // there is something to see
    EXPECT_LT((m.centre_mm - expected).norm(), 0.05) << name(plane);
    EXPECT_NEAR(m.volume_mm3 / (4.0 / 3.0 * M_PI * 729.0), 1.0, 0.03) << name(plane);
  }
}

TEST(Acquisition, B0MovesByPixelOverBandwidthAlongTheReadOut) {
  FieldOptions none;
  none.kind = FieldKind::kNone;
  none.b0_Hz = 0.0;
  const std::vector<Vector3d> sample{Vector3d(100, 0, 0)};
  const ScannerField field = ScannerField(none, sample, 1).with_b0([](const Vector3d &) { return 130.0; });
  Protocol protocol = coil_protocol(60);
  StackPlan plan = plan_of(Plane::kTransverse, Vector3d::Zero(), 20);
  const double pixels = 130.0 / 260.0;
  for (const bool reversed : {false, true}) {
    plan.read_reversed = reversed;
    const Vector3d moved = Acquisition(field, protocol, plan).believed_mm(Vector3d(10, 20, 5)) - Vector3d(10, 20, 5);
    EXPECT_NEAR(moved.dot(plan.along_row), (reversed ? -1.0 : 1.0) * pixels * 300.0 / 192.0, 1e-6);
    EXPECT_NEAR(moved.dot(plan.normal()), 130.0 / 1500.0 * 1.5, 1e-6);
    EXPECT_NEAR(moved.dot(plan.along_column), 0.0, 1e-9);
  }
}

TEST(Acquisition, TheVendorsCorrectionLeavesB0) {
  FieldOptions options;
  options.b0_Hz = 0.0;
  const ScannerField field =
      ScannerField(options, Phantom({}).crossings_mm(), 5).with_b0([](const Vector3d &) { return 130.0; });
  const Vector3d place(-50, 30, 45);
  const Protocol protocol = coil_protocol(60);
  const Acquisition acquisition(field, protocol, plan_of(Plane::kCoronal, place, 24));
  const Stack corrected = vendor_corrected(acquisition.clean(Ball(place, 9.0), BodyPose()), field);
  const Vector3d left = acquisition.believed_mm(place) - field.gradient_mm(place);
  EXPECT_LT((moment(corrected, 1.0).centre_mm - left).norm(), 0.06);
}

TEST(SimulatedScanner, NoiseIsRician) {
  ScannerOptions options = quiet();
  options.appearance.snr = 20.0;
  SimulatedScanner scanner(options, 3);
  const Stack image = scanner.background(coil_protocol(60), plan_of(Plane::kCoronal, Vector3d(0, 55, 0), 3));
  double sum = 0.0;
  int n = 0;
  for (int i = 0; i < 192; ++i) { // outside the tank
    sum += static_cast<double>(image.at(i, 3, 1));
    ++n;
  }
  EXPECT_NEAR(sum / n, 50.0 * std::sqrt(M_PI / 2.0), 12.0);
}

TEST(SimulatedScanner, CurrentLeavesAHoleAroundTheCoilAndNothingElsewhere) {
  SimulatedScanner scanner(quiet(), 7);
  const Protocol protocol = coil_protocol(60);
  const StackPlan plan = plan_of(Plane::kCoronal, Vector3d(0, 55, 0), 60);
  const Stack background = scanner.background(protocol, plan);
  const Stack foreground = scanner.foreground(protocol, plan, {"mid-top"});
  const Stack opposite = scanner.foreground(protocol, plan, {"mid-top"}, -1);
  const Acquisition acquisition(scanner.field(), protocol, plan);
  std::vector<Vector3d> on;
  for (std::size_t i = 0; i < scanner.design().size(); ++i) {
    if (scanner.design()[i].group == "mid-top") {
      const Vector3d shown = acquisition.believed_mm(scanner.truth().coils_device_mm[i]);
      on.push_back(shown);
      const Vector3d a = artefact_centre(background, foreground, shown) - shown;
      const Vector3d b = artefact_centre(background, opposite, shown) - shown;
      EXPECT_LT(a.norm(), 1.5) << scanner.design()[i].name;
      EXPECT_LT(0.5 * (a + b).norm(), 0.6) << scanner.design()[i].name;
    }
  }
  ASSERT_EQ(on.size(), 4U);
  double deepest_far = 0.0, deepest_near = 0.0;
  for (std::size_t i = 0; i < background.voxels.size(); ++i) {
    const Vector3d at = background.pixel_mm(i);
    double nearest = 1e9;
    for (const Vector3d &c : on) {
      nearest = std::min(nearest, (at - c).norm());
    }
    const double change = std::abs(static_cast<double>(background.voxels[i] - foreground.voxels[i]));
    (nearest > 30.0 ? deepest_far : deepest_near) = std::max(nearest > 30.0 ? deepest_far : deepest_near, change);
  }
  EXPECT_GT(deepest_near, 800.0);
  EXPECT_LT(deepest_far, 1.0);
}

TEST(SimulatedScanner, ABrokenCoilStaysDark) {
  SimulatedScanner scanner(quiet(), 8);
  for (std::size_t i = 0; i < scanner.design().size(); ++i) {
    if (scanner.design()[i].group == "tree") {
      scanner.break_coil(i);
    }
  }
  const StackPlan plan = plan_of(Plane::kTransverse, Vector3d::Zero(), 4);
  EXPECT_EQ(scanner.background(coil_protocol(120), plan).voxels,
            scanner.foreground(coil_protocol(120), plan, {"tree"}).voxels);
}

TEST(SimulatedScanner, TheSameSeedGivesTheSameSession) {
  ScannerOptions options;
  options.errors.bubbles = 2;
  SimulatedScanner one(options, 9), two(options, 9), other(options, 10);
  StackPlan plan = one.phantom_plan();
  plan.slices = 3;
  Protocol protocol = phantom_protocol();
  protocol.matrix = 128;
  const Stack image = one.phantom(protocol, plan);
  EXPECT_EQ(image.voxels, two.phantom(protocol, plan).voxels);
  EXPECT_NE(image.voxels, other.phantom(protocol, plan).voxels);
}

TEST(SimulatedScanner, TheCtShowsTheBarsOfThePhantomInPlace) {
  SimulatedScanner scanner(quiet(), 11);
  const Stack ct = scanner.ct(2.0);
  EXPECT_EQ(ct.size[0], 256);
  // Voxels at crossings are plastic, those in the middle of squares are not.
  const Eigen::Matrix4d T_index_ct = ct.T_image_index.inverse();
  const auto value = [&](const Vector3d &p) {
    const Vector3d at =
        T_index_ct.topLeftCorner<3, 3>() * (scanner.truth().T_ct_phantom * p) + T_index_ct.topRightCorner<3, 1>();
    return static_cast<double>(ct.at(static_cast<int>(std::lround(at.x())), static_cast<int>(std::lround(at.y())),
                                     static_cast<int>(std::lround(at.z()))));
  };
  const PhantomDesign design;
  const Phantom phantom(design);
  double least = 1e9, most = -1e9;
  for (const Vector3d &p : phantom.crossings_mm()) {
    if (p.cwiseAbs().maxCoeff() < 70.0) {
      least = std::min(least, value(p));
      most = std::max(most, value(p + Vector3d::Constant(0.5 * design.pitch_mm())));
    }
  }
  EXPECT_GT(least, 500.0);
  EXPECT_LT(most, 200.0);
}

} // namespace bregma::sim::scanner::test
