// How a probe and the tissue hold each other: pressing on the surface, and inside the tissue along a cut.
//
// Both work on the nodes that the solver has predicted, by impulses (Gauss-Seidel over the points of contact, each with
// its own effective mass; on the surface what was pushed too far is taken back), so they are stable at any stiffness,
// and what they exert is known: impulse / step.
//
// One thread at a time; apply() does not allocate or throw. Forces are those of the probe on the tissue.
#pragma once

#include <array>
#include <vector>

#include "algorithms/tissue/contact/probe_shape.hpp"
#include "algorithms/tissue/mesh/tet_locator.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

// Points strewn over the mesh's surface, where it is near the probe, must not be inside the probe. Coulomb friction.
class SurfaceContact final : public Contact {
public:
  struct Options {
    double friction = 0.1;
    double spacing_mm = 1.5; // of the points on the surface
    double reach_mm = 5.0;   // triangles farther from the probe than this are not looked at until the next search()
    int capacity = 20000;    // points; nearer triangles come first
  };

  SurfaceContact(const TetMesh &mesh, const TetBoundary &boundary, const Options &options);

  void place(const PlacedProbe &probe) noexcept { probe_ = probe; }
  void set_active(bool active) noexcept { active_ = active; }
  // Finds the triangles near the probe again. When it has moved by some millimetres.
  void search(const ExplicitSolver &solver) noexcept;

  void apply(const NodeMotion &nodes) noexcept override;

  // Of the last step.
  [[nodiscard]] Eigen::Vector3f force_N() const noexcept { return force_N_; }
  [[nodiscard]] int touching() const noexcept { return touching_; } // points
  // As long as a point touches: the depth of the dent along the shaft.
  [[nodiscard]] double depth_mm() const noexcept { return depth_mm_; }
  // Of the point that was deepest inside the probe: its place at rest, how far up the shaft from the tip it is now, and
  // the tetrahedron that it belongs to.
  [[nodiscard]] const Eigen::Vector3f &touched_rest_m() const noexcept { return touched_rest_; }
  [[nodiscard]] float touched_height_m() const noexcept { return touched_height_; }
  [[nodiscard]] int touched_tetrahedron() const noexcept { return touched_tetrahedron_; }

private:
  struct Point {
    int triangle;
    int node[3];
    float barycentric[3];
  };
  struct Near {
    float distance_mm;
    int triangle;
  };

  struct Push { // of a point in a step: out of the probe, and by friction along it
    float out_m = 0.0F;
    Eigen::Vector3f aside_m = Eigen::Vector3f::Zero();
  };
  struct NearPoint {
    const Point *point;
    Push push;
  };

  float push_out(const NodeMotion &nodes, const Point &point, Push &push) noexcept;

  const TetMesh *mesh_;
  const TetBoundary *boundary_;
  Options options_;
  PlacedProbe probe_;
  bool active_ = false;
  std::vector<int> divisions_; // of each triangle's edges
  std::vector<Near> near_;
  std::vector<Point> points_;
  std::vector<NearPoint> near_points_;
  Eigen::Vector3f force_N_ = Eigen::Vector3f::Zero();
  int touching_ = 0;
  double depth_mm_ = 0.0;
  Eigen::Vector3f touched_rest_ = Eigen::Vector3f::Zero();
  float touched_height_ = 0.0F;
  int touched_tetrahedron_ = -1;
};

// Tissue along the cut stays on the shaft's axis, and slides along it against friction; at the tip it is pushed with
// the cutting force at the most (DiMaio & Salcudean, IEEE Trans Robot Autom 19 (2003) 864: sticking and slipping along
// a needle). What is held and pushed are discs across the shaft, by their mean: a force on one point would turn the
// tetrahedron around it inside out. The discs are left behind by the tip as it advances, and given up as it comes back
// past them. A disc that is pushed sideways with more than the tissue bears stays behind where it is then.
class CutContact final : public Contact {
public:
  struct Forces {
    float cutting_N = 0.0F;        // at the tip, at the most; 0 where the tissue is cut already
    float friction_N_per_m = 0.0F; // along the shaft
    float sideways_N_per_m = 1e9F; // across it: with more the shaft cuts its way sideways
  };

  // spacing_mm: between held discs.
  CutContact(const TetMesh &mesh, const TetLocator &locator, double spacing_mm, double section_radius_mm);

  void place(const PlacedProbe &probe) noexcept { probe_ = probe; }
  void set_forces(const Forces &forces) noexcept { forces_ = forces; }
  // tetrahedron: one near the tip. The shaft is taken to be in the tissue as far as it reaches there now.
  void begin(int tetrahedron) noexcept;
  void end() noexcept;

  void apply(const NodeMotion &nodes) noexcept override;

  // Of the last step.
  [[nodiscard]] const MaterialPoint &tip() const noexcept { return tip_; } // the tissue at the tip
  [[nodiscard]] Eigen::Vector3f tip_rest_m() const noexcept { return tip_rest_; }
  [[nodiscard]] float tip_force_N() const noexcept { return tip_force_; } // along the probe, into the tissue
  [[nodiscard]] Eigen::Vector3f shaft_force_N() const noexcept { return shaft_force_; }
  // Of the shaft inside the tissue; 0: it has come out.
  [[nodiscard]] float length_m() const noexcept { return length_; }

private:
  static constexpr std::size_t kMaxSections = 256;
  static constexpr std::size_t kSectionPoints = 7;

  struct Section { // a weighted mean of nodes; the shares sum to one
    std::array<int, 4 * kSectionPoints> node{};
    std::array<float, 4 * kSectionPoints> weight{};
    int count = 0;
    // From the axis to its mean when it was gripped, and by what the shaft has cut sideways since: not zero where part
    // of the disc lies outside the mesh.
    Eigen::Vector3f offset = Eigen::Vector3f::Zero();
    Eigen::Vector3f pushed_N_s = Eigen::Vector3f::Zero(); // sideways, in this step

    void add(const Eigen::Vector4i &tetrahedron, const MaterialPoint &point) noexcept;
  };
  struct Grip { // of the probe on a disc
    Eigen::Vector3f from_tip = Eigen::Vector3f::Zero();
    Eigen::Vector3f slip = Eigen::Vector3f::Zero(); // velocity against the probe
    float mobility = 0.0F;                          // 1 / effective mass; 0: cannot be moved
  };

  [[nodiscard]] MaterialPoint find(const NodeMotion &nodes, const Eigen::Vector3f &at_m, int guess) const noexcept;
  [[nodiscard]] Section section_at(const NodeMotion &nodes, const MaterialPoint &middle,
                                   const Eigen::Vector3f &at_m) const noexcept;
  [[nodiscard]] Grip grip(const NodeMotion &nodes, const Section &section) const noexcept;
  void push(const NodeMotion &nodes, const Section &section, const Eigen::Vector3f &impulse) const noexcept;
  void find_tip(const NodeMotion &nodes) noexcept;
  void update_constraints(const NodeMotion &nodes) noexcept;

  const TetMesh *mesh_;
  const TetLocator *locator_;
  float spacing_m_, section_radius_m_;
  PlacedProbe probe_;
  Forces forces_;
  bool active_ = false;
  bool fresh_ = false;            // begin() was called: nothing is held yet
  int guess_ = 0;                 // where the tip was last
  std::vector<Section> sections_; // the lowest last
  MaterialPoint tip_;
  Section tip_section_;
  Eigen::Vector3f tip_rest_ = Eigen::Vector3f::Zero();
  float tip_force_ = 0.0F;
  float length_ = 0.0F;
  Eigen::Vector3f shaft_force_ = Eigen::Vector3f::Zero();
};

} // namespace bregma::tissue
