// A rigid probe that is pushed along +x into a plane section of tissue: it indents the surface until that ruptures,
// then goes on in a channel that it cuts.
//
// Shape: two parallel sides `width_mm` apart around the line y = axis_y_mm, ended by half an ellipse of length nose_mm
// (half the width: half a circle; towards 0: a flat end, resolved no finer than the mesh's edge). Contact is kinematic:
// where a node would go in a step into the probe, it is put onto its surface, and friction holds it to the place where
// it first touched up to friction times that correction: Coulomb's law when everything is at rest. Nodes are kept out,
// edges are not: the end's corners may cut an edge of the mesh. The surface's node on the axis does not slide off the
// tip: under a deep indentation its neighbours are drawn so far apart that the surface would let the probe through.
//
// Phases. Indentation: the end alone bears. Rupture, when the end's force or the stress under it reaches its limit: the
// mesh is cut open along the axis, node by node, as far as the tip reaches while it pushes the next node ahead with the
// cutting force, a constant as it is usual for needles (Okamura, Simone & O'Leary 2004); the surface springs back and
// the two lips meet. Penetration: the lips are pressed apart to the probe's sides, and each node that the tip reaches
// is cut. The tip stands between two nodes, so its force acts up to an edge ahead of it. The lips may not cross the
// axis: it stands for their contact with each other. Nothing is taken away.
//
// mm and N per metre of thickness, in the mesh's axes. Not for several threads.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/tissue_plane/plane_solver.hpp"

namespace bregma::tissue_plane {

struct PlaneProbeSettings {
  double axis_y_mm = 0.0;
  double width_mm = 6.0;
  double nose_mm = 3.0;
  double friction = 0.1;
  double rupture_N_m = std::numeric_limits<double>::infinity(); // force of the end along x
  double rupture_Pa = std::numeric_limits<double>::infinity();  // von Mises (3-D) of the node on the axis under the end
  double cutting_fraction = 0.5;                                // of the end's force at rupture: the cutting force
  double step_mm = 0.5;                                         // the tip goes no further between two states of rest
  PlaneRelaxationOptions relax_between = {3e-3, 20'000};
  PlaneRelaxationOptions relax_at_end = {1e-3, 50'000};
};

enum class ProbePhase { kApart, kIndentation, kRupture, kPenetration };

struct ProbeReading {
  ProbePhase phase = ProbePhase::kApart;
  double tip_mm = 0.0;       // x
  double tip_N_m = 0.0;      // how hard the end pushes the tissue along +x
  double plus_N_m = 0.0;     // how hard the tissue presses on the side towards y+, normal to it
  double minus_N_m = 0.0;    // and on the side towards y-
  double friction_N_m = 0.0; // how hard both sides drag the tissue along +x
  double cut_mm = 0.0;       // length of the channel, in the tissue at rest
  PlaneRelaxationResult rest;
};

class PlaneProbe : public PlaneContact {
public:
  // The solver is used by reference and must outlive the probe; its mesh must have edges along the axis
  // (PlaneMeshing::cut_y_mm). The tip stands where it just touches the first node of the axis. Throws
  // std::invalid_argument with the value that is wrong: no such edges, a width, nose, step or friction out of range.
  PlaneProbe(PlaneSolver &solver, const PlaneProbeSettings &settings);
  ~PlaneProbe() override;
  PlaneProbe(const PlaneProbe &) = delete;
  PlaneProbe &operator=(const PlaneProbe &) = delete;

  [[nodiscard]] double entry_mm() const; // x of the surface on the axis, at rest
  // Forward only. Stops where the tissue ruptures: phase kRupture, nothing cut yet. From there it opens the channel
  // first.
  ProbeReading move_to(double tip_mm);
  // Whether or not a limit is reached: cuts from the surface inwards while the tip alone bears: the moment of rupture,
  // the load dropped to the cutting force. Does nothing in kPenetration.
  ProbeReading rupture();
  // Presses the lips apart to the probe's sides: kPenetration. Ruptures first where that was not done.
  ProbeReading open();

  [[nodiscard]] ProbeReading reading() const;
  [[nodiscard]] bool ruptured() const { return cut_ > 0; }

  void project(std::span<Eigen::Vector2d> next_m) override;
  [[nodiscard]] bool arrived() const override { return tip_mm_ == goal_mm_ && narrowest_mm_ >= half_mm_; }

private:
  enum class Part : signed char { kNone, kEnd, kSide };
  struct Candidate {
    int node = 0;
    int side = 0; // 1: lip above the axis, -1: below, 0: not cut
    Part touching = Part::kNone;
    double open_mm = 0.0; // of a lip: how far from the axis it may be pushed by now
    bool anchored = false;
    Eigen::Vector2d anchor_mm = Eigen::Vector2d::Zero(); // where it touched, from the tip
  };
  void find_path();
  void settle(const PlaneRelaxationOptions &limits);
  void cut_next();
  void cut_reached_nodes();
  [[nodiscard]] bool at_its_limit() const;
  [[nodiscard]] Part push_out(Eigen::Vector2d &from_tip_mm, const Candidate &c) const;
  void keep_out(Candidate &c, Eigen::Vector2d &position_m);
  [[nodiscard]] Candidate &candidate(int node);

  PlaneSolver &solver_;
  PlaneProbeSettings settings_;
  std::vector<int> path_;               // nodes of the axis, from the surface inwards
  std::vector<std::vector<int>> below_; // triangles of each below the axis
  std::vector<Candidate> candidates_;
  double cutting_N_m_ = 0.0;
  std::size_t cut_ = 0; // so many nodes of the path are cut; path_[cut_] is before the tip
  ProbePhase phase_ = ProbePhase::kApart;
  bool blade_ = false; // during rupture: the tip alone bears
  double tip_mm_ = 0.0;
  double goal_mm_ = 0.0;
  double half_mm_ = 0.0;      // of the width
  double narrowest_mm_ = 0.0; // the least open_mm of all lips
  double pace_mm_ = 0.0;      // the probe's way in a step of the solver
  PlaneRelaxationResult rest_;
};

} // namespace bregma::tissue_plane
