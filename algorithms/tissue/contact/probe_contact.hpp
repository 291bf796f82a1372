// Contact between a probe and the tissue: on the surface, and inside the tissue along a cut.
//
// Both contacts apply impulses to the nodes that the solver has predicted: Gauss-Seidel over the contact points, each
// with its own effective mass. On the surface, excess impulses are taken back. The contacts are therefore stable at any
// stiffness, and their force is known: impulse / step.
//
// One thread at a time; apply() does not allocate or throw. Forces are those of the probe on the tissue.
#pragma once

#include <array>
#include <vector>

#include "algorithms/tissue/contact/probe_shape.hpp"
#include "algorithms/tissue/mesh/tet_locator.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

// Points distributed over the mesh's surface near the probe must not be inside the probe. Coulomb friction.
class SurfaceContact final : public Contact {
public:
  struct Options {
    double friction = 0.1;
    double spacing_mm = 1.5; // distance of the points on the surface
    double reach_mm = 5.0;   // triangles farther from the probe are ignored until the next search()
    int capacity = 20000;    // points; nearer triangles come first
  };

  SurfaceContact(const TetMesh &mesh, const TetBoundary &boundary, const Options &options);

  void place(const PlacedProbe &probe) noexcept { probe_ = probe; }
  void set_active(bool active) noexcept { active_ = active; }
  // Finds the triangles near the probe again. To be called when it has moved by some millimetres.
  void search(const ExplicitSolver &solver) noexcept;

  void apply(const NodeMotion &nodes) noexcept override;

  // Results of the last step.
  [[nodiscard]] Eigen::Vector3f force_N() const noexcept { return force_N_; }
  [[nodiscard]] int touching() const noexcept { return touching_; } // points
  // Depth of the indentation along the shaft, as long as a point touches.
  [[nodiscard]] double depth_mm() const noexcept { return depth_mm_; }
  // The point that was deepest inside the probe: its position at rest, its present height above the tip along the
  // shaft, and its tetrahedron.
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

  struct Push { // move of a point in a step: out of the probe, and by friction along it
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
  std::vector<int> divisions_; // number per edge of each triangle
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

// Constrained cross-sections keep the tissue along the cut on the shaft's axis. They stick or slip along it, as the
// nodes along a needle do in [DiMaio 2003]; the tip pushes with at most the cutting force. A constraint acts on the
// mean of a cross-section: a force on one point would invert the tetrahedron around it. The tip leaves cross-sections
// behind as it advances, and they are released as it retreats past them. Where a sideways load exceeds what the tissue
// bears, the cross-section is released at its present offset.
class CutContact final : public Contact {
public:
  struct Forces {
    float cutting_N = 0.0F;        // maximum at the tip; 0 where the tissue is cut already
    float friction_N_per_m = 0.0F; // along the shaft
    float sideways_N_per_m = 1e9F; // maximum across the shaft: beyond it the shaft cuts sideways
  };

  // spacing_mm: distance between the constrained cross-sections.
  CutContact(const TetMesh &mesh, const TetLocator &locator, double spacing_mm, double section_radius_mm);

  void place(const PlacedProbe &probe) noexcept { probe_ = probe; }
  void set_forces(const Forces &forces) noexcept { forces_ = forces; }
  // tetrahedron: one near the tip. Cross-sections are constrained along all of the shaft that is in the tissue now.
  void begin(int tetrahedron) noexcept;
  void end() noexcept;

  void apply(const NodeMotion &nodes) noexcept override;

  // Results of the last step.
  [[nodiscard]] const MaterialPoint &tip() const noexcept { return tip_; } // the tissue at the tip
  [[nodiscard]] Eigen::Vector3f tip_rest_m() const noexcept { return tip_rest_; }
  [[nodiscard]] float tip_force_N() const noexcept { return tip_force_; } // along the probe, into the tissue
  [[nodiscard]] Eigen::Vector3f shaft_force_N() const noexcept { return shaft_force_; }
  // Length of the shaft inside the tissue; 0: it is outside.
  [[nodiscard]] float length_m() const noexcept { return length_; }

private:
  static constexpr std::size_t kMaxSections = 256;
  static constexpr std::size_t kSectionPoints = 7;

  struct Section { // a cross-section as the weighted mean of nodes; the weights sum to one
    std::array<int, 4 * kSectionPoints> node{};
    std::array<float, 4 * kSectionPoints> weight{};
    int count = 0;
    // From the axis to the mean when the section was constrained, plus what the shaft has cut sideways since. Not zero
    // where part of the section lies outside the mesh.
    Eigen::Vector3f offset = Eigen::Vector3f::Zero();
    Eigen::Vector3f pushed_N_s = Eigen::Vector3f::Zero(); // sideways impulse in this step

    void add(const Eigen::Vector4i &tetrahedron, const MaterialPoint &point) noexcept;
  };
  struct Grip { // state of a section relative to the probe
    Eigen::Vector3f from_tip = Eigen::Vector3f::Zero();
    Eigen::Vector3f slip = Eigen::Vector3f::Zero(); // velocity relative to the probe
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
  bool fresh_ = false;            // begin() was called: no section is constrained yet
  int guess_ = 0;                 // tetrahedron of the tip in the last step
  std::vector<Section> sections_; // ordered from the entry to the tip
  MaterialPoint tip_;
  Section tip_section_;
  Eigen::Vector3f tip_rest_ = Eigen::Vector3f::Zero();
  float tip_force_ = 0.0F;
  float length_ = 0.0F;
  Eigen::Vector3f shaft_force_ = Eigen::Vector3f::Zero();
};

} // namespace bregma::tissue
