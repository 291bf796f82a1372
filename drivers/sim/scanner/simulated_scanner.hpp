// One simulated session of [Tuna 2022]: a scanner with its field, the phantom in CT and MR, and the registration frame
// whose coils are switched. The seed decides the field and every hidden error.
//
// What an estimator may know: images, protocols, frame_design() and which coils carry current. What it may not know is
// in truth(): where bodies and coils really are, and the field. Not for several threads at a time.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/sim/scanner/acquisition.hpp"

namespace bregma::sim::scanner {

// One-sigma sizes of errors that no estimator is told of.
struct HiddenErrors {
  double build_mm = 0.2;        // per axis: where a coil really is on the frame
  double placement_mm = 3.0;    // per axis: phantom and frame against the isocentre
  double placement_deg = 2.0;   // per axis
  double drift_mm = 0.03;       // per axis: movement between background and foreground
  double current_ripple = 0.02; // relative, per coil and scan
  double ct_noise = 30.0;       // plastic is 1000
  int bubbles = 0;              // in the phantom's water
};

struct ScannerOptions {
  FieldOptions field;
  HiddenErrors errors;
  Appearance appearance;
  PhantomDesign phantom;
  double current_mA = 75.0;
  // Groups of coils around which images are sampled finely (Acquisition::clean); empty: all.
  std::vector<std::string> fine_groups;
};

struct Truth {
  BodyPose T_device_base; // of the registration frame
  BodyPose T_device_phantom;
  BodyPose T_ct_phantom;                 // Device stands for the CT's own frame
  std::vector<Vector3d> coils_device_mm; // in the order of the design, with the errors of building
  std::vector<Vector3d> crossings_mm;    // in Device, as Phantom::crossings_mm
};

class SimulatedScanner {
public:
  // field: of another session of the same scanner; null: one is made by the options and the seed.
  SimulatedScanner(const ScannerOptions &options, std::uint64_t seed,
                   std::shared_ptr<const ScannerField> field = nullptr);

  // The phantom in CT: voxels of 216 / 512 mm and 0.6 mm, 319 slices, times `coarser` (1 is the paper's 334 MB).
  [[nodiscard]] Stack ct(double coarser = 1.0);
  // The phantom in MR, with its bubbles. The paper's orientation is coronal.
  [[nodiscard]] Stack phantom(const Protocol &protocol, const StackPlan &plan);
  [[nodiscard]] StackPlan phantom_plan(Plane plane = Plane::kCoronal) const; // covers the phantom with 1 mm slices

  // The frame without current, and with current in the named groups, in the direction of the polarity (+1 or -1).
  [[nodiscard]] Stack background(const Protocol &protocol, const StackPlan &plan);
  [[nodiscard]] Stack foreground(const Protocol &protocol, const StackPlan &plan,
                                 const std::vector<std::string> &groups, int polarity = 1);

  [[nodiscard]] const Truth &truth() const { return truth_; }
  [[nodiscard]] const ScannerField &field() const { return *field_; }
  [[nodiscard]] const std::shared_ptr<const ScannerField> &shared_field() const { return field_; }
  [[nodiscard]] const std::vector<CoilDesign> &design() const { return design_; }
  // What happens to the run: a coil that stays dark, a frame that moved, a field that changed.
  void break_coil(std::size_t index) { broken_.at(index) = true; }
  void move_frame(const BodyPose &T_device_base);
  void set_field(ScannerField field);
  // A ball of another susceptibility in the bore: a dipole's field outside, none inside.
  void enter_ball(double ppm, const Vector3d &centre_mm, double radius_mm);

private:
  struct Scan { // the frame without current, kept between background and foreground
    Protocol protocol;
    StackPlan plan;
    std::unique_ptr<Acquisition> acquisition;
    Stack clean;
  };
  const Scan &scan_of(const Protocol &protocol, const StackPlan &plan);
  [[nodiscard]] LocalField currents(const std::vector<std::string> &groups, int polarity);
  [[nodiscard]] LocalField bubbles();
  void place_coils();

  ScannerOptions options_;
  std::uint64_t seed_;
  Random noise_, drift_, ripple_;
  std::vector<CoilDesign> design_;
  std::vector<Vector3d> built_mm_; // in the frame's own frame
  std::vector<bool> broken_;
  RegistrationFrame frame_;
  Phantom phantom_;
  Truth truth_;
  std::shared_ptr<const ScannerField> field_;
  std::unique_ptr<Scan> scan_;
};

} // namespace bregma::sim::scanner
