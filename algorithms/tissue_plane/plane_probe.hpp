// A rigid probe that is pushed along +x into a plane section of tissue. It indents the surface until that ruptures,
// then advances in a channel that it cuts.
//
// Shape: two parallel sides `width_mm` apart around the line y = axis_y_mm. The end is half an ellipse of length
// nose_mm (half the width: half a circle; towards 0: a flat end, resolved no finer than the mesh's edge). Contact is
// kinematic: a node that would enter the probe in a step is moved onto its surface. Friction holds it at the point of
// first contact, up to friction times that correction, which is Coulomb's law at rest. Only nodes are kept out: the
// end's corners may cut an edge of the mesh. The surface's node on the axis cannot slide off the tip: under a deep
// indentation its neighbours are so far apart that the probe would pass through the surface.
//
// Phases. Indentation: only the end is in contact. Rupture, when the force on the end or the stress under it reaches
// its limit: the mesh is cut open along the axis, node by node, up to the tip. The tip pushes the next node with the
// cutting force, a constant as is usual for needles [Okamura 2004]. The surface springs back, and the two lips meet.
// Penetration: the lips are pressed apart to the probe's sides, and each node that the tip reaches is cut. The tip is
// between two nodes, so that its force acts up to one edge ahead of it. The lips cannot cross the axis, which
// represents their contact with each other. No material is removed.
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
  double cutting_fraction = 0.5;                                // cutting force over the end's force at rupture
  double step_mm = 0.5;                                         // maximum advance of the tip between two states of rest
  PlaneRelaxationOptions relax_between = {3e-3, 20'000};
  PlaneRelaxationOptions relax_at_end = {1e-3, 50'000};
};

enum class ProbePhase { kApart, kIndentation, kRupture, kPenetration };

struct ProbeReading {
  ProbePhase phase = ProbePhase::kApart;
  double tip_mm = 0.0;       // x
  double tip_N_m = 0.0;      // force of the end on the tissue along +x
  double plus_N_m = 0.0;     // normal force of the tissue on the side towards y+
  double minus_N_m = 0.0;    // the same on the side towards y-
  double friction_N_m = 0.0; // friction force of both sides on the tissue along +x
  double cut_mm = 0.0;       // length of the channel, in the tissue at rest
  PlaneRelaxationResult rest;
};

class PlaneProbe : public PlaneContact {
public:
  // The solver is used by reference and must outlive the probe; its mesh must have edges along the axis
  // (PlaneMeshing::cut_y_mm). The tip starts where it just touches the first node of the axis. Throws
  // std::invalid_argument with the value that is wrong: no such edges, a width, nose, step or friction out of range.
  PlaneProbe(PlaneSolver &solver, const PlaneProbeSettings &settings);
  ~PlaneProbe() override;
  PlaneProbe(const PlaneProbe &) = delete;
  PlaneProbe &operator=(const PlaneProbe &) = delete;

  [[nodiscard]] double entry_mm() const; // x of the surface on the axis, at rest
  // Forward only. Stops when the tissue ruptures: phase kRupture, nothing cut yet. The next call opens the channel
  // first.
  ProbeReading move_to(double tip_mm);
  // Ruptures regardless of the limits: cuts from the surface inwards while only the tip is in contact, with the load
  // reduced to the cutting force. Does nothing in kPenetration.
  ProbeReading rupture();
  // Presses the lips apart to the probe's sides: kPenetration. Ruptures first if necessary.
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
    double open_mm = 0.0; // present limit of a lip's distance from the axis
    bool anchored = false;
    Eigen::Vector2d anchor_mm = Eigen::Vector2d::Zero(); // point of first contact, relative to the tip
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
  std::size_t cut_ = 0; // number of cut nodes of the path; path_[cut_] is ahead of the tip
  ProbePhase phase_ = ProbePhase::kApart;
  bool blade_ = false; // during rupture: only the tip is in contact
  double tip_mm_ = 0.0;
  double goal_mm_ = 0.0;
  double half_mm_ = 0.0;      // half of the width
  double narrowest_mm_ = 0.0; // minimum open_mm of all lips
  double pace_mm_ = 0.0;      // advance of the probe per solver step
  PlaneRelaxationResult rest_;
};

} // namespace bregma::tissue_plane
