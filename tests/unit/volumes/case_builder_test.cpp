#include "casefile/volumes/case_builder.hpp"

#include <algorithm>
#include <fstream>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "casefile/markups.hpp"
#include "casefile/volumes/case_picture.hpp"
#include "casefile/volumes/label_regions.hpp"
#include "casefile/volumes/volume.hpp"
#include "files.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

constexpr const char *kTools = R"([[tools]]
name = "Reference"
role = "reference"
markers_mm = [[0, 0, 0], [60, 0, 0], [0, 40, 0]]
)";

double smallest_distance(const Surface &surface, const std::vector<Eigen::Vector3d> &points) {
  const std::vector<Eigen::Vector3d> nearest = nearest_on_surface(surface.mesh, points);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t at = 0; at < points.size(); ++at) {
    least = std::min(least, (nearest[at] - points[at]).norm());
  }
  return least;
}

// A ball as head, a smaller one as brain with two regions, and a plan.
class SmallHead {
public:
  SmallHead() {
    Volume head = ball(20.0);
    Volume brain = ball(15.0);
    Volume labels = ball(0.0);
    for (int i = -1; i <= 1; ++i) {
      for (int j = 0; j < 10; ++j) {
        for (int k = 0; k < 10; ++k) {
          labels.voxels[labels.offset(18 + i, 20 + j, 20 + k)] = 3.0F;
          labels.voxels[labels.offset(34 + i, 20 + j, 20 + k)] = 4.0F;
        }
      }
    }
    EXPECT_TRUE(write_volume(scratch / "head.nii.gz", head) && write_volume(scratch / "brain.nrrd", brain) &&
                write_volume(scratch / "labels.nii.gz", labels));
    test::write_bytes(scratch / "labels.nii.txt", "3 Cuneus_L\n4 Cuneus_R\n");
    test::write_bytes(scratch / "tools.toml", kTools);
    const NamedPoint fiducials[] = {{"A", {22, 0, 0}}, {"B", {-19, 0, 0}}, {"C", {0, 20, 0}}, {"D", {0, 0, 21}}};
    const NamedPoint target[] = {{"T", {5, 5, 5}}};
    const Trajectory path[] = {{"P", {0, 0, 20}, {5, 5, 5}}};
    EXPECT_TRUE(write_points(scratch / "f.mrk.json", "f", fiducials) &&
                write_points(scratch / "t.mrk.json", "t", target) && write_trajectories(scratch / "p.mrk.json", path));
  }

  [[nodiscard]] CaseSources sources() const {
    CaseSources out;
    out.id = "ball";
    out.image = scratch / "head.nii.gz";
    out.brain = scratch / "brain.nrrd";
    out.labels = scratch / "labels.nii.gz";
    out.structures = {{"Left", {"Cuneus_L"}}, {"Both", {"Cuneus_L", "4"}}};
    out.fiducials = scratch / "f.mrk.json";
    out.targets = scratch / "t.mrk.json";
    out.trajectories = scratch / "p.mrk.json";
    out.tools = scratch / "tools.toml";
    out.vertices = 600;
    return out;
  }

  // Files next to the case: no partial results may remain.
  [[nodiscard]] int hidden_entries() const {
    int count = 0;
    for (const auto &entry : fs::directory_iterator(scratch.path())) {
      count += entry.path().filename().string().starts_with(".") ? 1 : 0;
    }
    return count;
  }

  TemporaryFolder scratch;

private:
  static Volume ball(double radius_mm) {
    Volume volume;
    volume.size = {52, 50, 54};
    volume.T_image_index.col(3) << -25.0, -24.0, -26.0, 1.0;
    for (int k = 0; k < volume.size[2]; ++k) {
      for (int j = 0; j < volume.size[1]; ++j) {
        for (int i = 0; i < volume.size[0]; ++i) {
          volume.voxels.push_back(volume.point_mm({double(i), double(j), double(k)}).norm() < radius_mm ? 100.0F
                                                                                                        : 0.0F);
        }
      }
    }
    return volume;
  }
};

TEST(CreateCase, MakesAFolderThatLoads) {
  const SmallHead head;
  const fs::path folder = head.scratch / "case";
  std::string last_stage;
  const auto created = create_case(folder, head.sources(), false, [&](double, std::string_view stage) {
    last_stage = stage;
    return true;
  });
  ASSERT_TRUE(created) << created.error().message;
  EXPECT_EQ("done", last_stage);
  EXPECT_EQ(4U, created->surfaces.size());
  const auto loaded = load_case(folder);
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ("ball", loaded->id);
  EXPECT_TRUE(fs::exists(loaded->image));
  EXPECT_EQ(test::read_bytes(head.scratch / "head.nii.gz"), test::read_bytes(loaded->image))
      << "the image is kept as it is";
  ASSERT_EQ(2U, loaded->structures.size());
  EXPECT_EQ("Left", loaded->structures[0].name);
  EXPECT_EQ(2, check_mesh(loaded->structures[1].mesh).components);
  EXPECT_TRUE(check_mesh(loaded->scalp.mesh).closed);
  EXPECT_NEAR(33.5, check_mesh(loaded->scalp.mesh).volume_ml, 0.7); // 4/3 pi 20^3
  EXPECT_TRUE(loaded->fiducials[0].position_mm.isApprox(Eigen::Vector3d(22, 0, 0), 1e-9))
      << "not moved unless asked to";
  ASSERT_TRUE(loaded->craniotomy);
  EXPECT_EQ("P", loaded->craniotomy->trajectory);
  EXPECT_EQ(std::nullopt, loaded->craniotomy->radius_mm) << "is for the configuration to say";
  EXPECT_FALSE(loaded->tissue);
  EXPECT_EQ(0, head.hidden_entries());
}

TEST(CreateCase, TheLabelsAreKeptWithNamesAndColours) {
  const SmallHead head;
  const fs::path folder = head.scratch / "case";
  const auto created = create_case(folder, head.sources(), false);
  ASSERT_TRUE(created) << created.error().message;
  ASSERT_TRUE(created->value.labels);
  EXPECT_TRUE(fs::exists(created->value.labels->file)) << "its place is that of the finished folder";
  const auto loaded = load_case(folder);
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_TRUE(loaded->labels);
  const auto before = read_labels(head.scratch / "labels.nii.gz");
  const auto kept = read_labels(loaded->labels->file);
  ASSERT_TRUE(before && kept);
  EXPECT_EQ(before->voxels, kept->voxels);
  EXPECT_EQ(before->T_image_index, kept->T_image_index);
  const auto regions = read_label_regions(loaded->labels->table);
  ASSERT_TRUE(regions) << regions.error().message;
  ASSERT_EQ(regions->size(), 2U);
  EXPECT_EQ(regions->at(3).name, "Cuneus_L");
  EXPECT_NE(regions->at(3).colour, regions->at(4).colour);

  // A case that is written again, as `bregma image add` does, keeps them.
  ASSERT_TRUE(save_case(*loaded));
  EXPECT_TRUE(load_case(folder)->labels);

  fs::remove(loaded->labels->file);
  const auto without = load_case(folder);
  ASSERT_FALSE(without);
  EXPECT_NE(without.error().message.find("labels.file = \"labels.nii.gz\": no such file"), std::string::npos)
      << without.error().message;

  CaseSources sources = head.sources();
  sources.labels.clear();
  sources.structures.clear();
  ASSERT_TRUE(create_case(head.scratch / "plain", sources, false));
  EXPECT_FALSE(load_case(head.scratch / "plain")->labels);
}

TEST(CreateCase, WithoutATrajectoryThereIsNoCraniotomy) {
  const SmallHead head;
  CaseSources sources = head.sources();
  sources.trajectories.clear();
  ASSERT_TRUE(create_case(head.scratch / "case", sources, false));
  const auto loaded = load_case(head.scratch / "case");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_FALSE(loaded->craniotomy);
}

TEST(CreateCase, ABrainIsNotNeeded) {
  const SmallHead head;
  CaseSources sources = head.sources();
  sources.brain.clear();
  const auto created = create_case(head.scratch / "case", sources, false);
  ASSERT_TRUE(created) << created.error().message;
  EXPECT_EQ(3U, created->surfaces.size()) << "the scalp and two structures";
  const auto loaded = load_case(head.scratch / "case");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_TRUE(loaded->brain.mesh.triangles.empty());
  EXPECT_FALSE(loaded->craniotomy) << "is of the tissue model";
  EXPECT_EQ(2U, loaded->structures.size());
}

TEST(CreateCase, SnapsPointsOntoTheScalp) {
  const SmallHead head;
  CaseSources sources = head.sources();
  sources.snap = true;
  ASSERT_TRUE(create_case(head.scratch / "case", sources, false));
  const auto loaded = load_case(head.scratch / "case");
  ASSERT_TRUE(loaded);
  for (const NamedPoint &fiducial : loaded->fiducials) {
    EXPECT_NEAR(0.0, smallest_distance(loaded->scalp, {fiducial.position_mm}), 1e-3);
    EXPECT_NEAR(20.0, fiducial.position_mm.norm(), 0.6);
  }
  std::vector<NamedPoint> far{{"near", {0, 21, 0}}, {"far", {0, 90, 0}}};
  const auto refused = snap_points(far, loaded->scalp, kMaxSnap_mm);
  ASSERT_FALSE(refused);
  EXPECT_TRUE(refused.error().message.starts_with("\"far\" lies ")) << refused.error().message;
  EXPECT_EQ(21.0, far[0].position_mm.y()) << "all or none";
}

TEST(CreateCase, LeavesNoPartialFolder) {
  const SmallHead head;
  const fs::path folder = head.scratch / "case";
  const auto stopped =
      create_case(folder, head.sources(), false, [](double done, std::string_view) { return done < 0.6; });
  ASSERT_FALSE(stopped);
  EXPECT_NE(std::string::npos, stopped.error().message.find("stopped"));
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_EQ(0, head.hidden_entries());
}

TEST(CreateCase, ReplacesOnlyACaseAndKeepsItsSessions) {
  const SmallHead head;
  const fs::path folder = head.scratch / "case";
  fs::create_directories(folder);
  test::write_bytes(folder / "precious.txt", "no case");
  const auto taken = create_case(folder, head.sources(), true);
  ASSERT_FALSE(taken);
  EXPECT_EQ(folder.string() + ": exists and is not a case; it is left alone", taken.error().message);
  EXPECT_TRUE(fs::exists(folder / "precious.txt"));

  test::write_bytes(folder / "case.toml", "id = \"old\"\n");
  fs::create_directories(folder / "sessions");
  test::write_bytes(folder / "sessions/one.db", "recorded");
  const auto again = create_case(folder, head.sources(), false);
  ASSERT_FALSE(again);
  EXPECT_EQ(folder.string() + ": there is a case already; --force replaces it and keeps its sessions",
            again.error().message);
  ASSERT_TRUE(create_case(folder, head.sources(), true));
  EXPECT_TRUE(load_case(folder));
  EXPECT_EQ("recorded", test::read_bytes(folder / "sessions/one.db"));
  EXPECT_FALSE(fs::exists(folder / "precious.txt"));
  EXPECT_EQ(0, head.hidden_entries());
}

TEST(CreateCase, ErrorsAreReportedWithTheReason) {
  const SmallHead head;
  const auto message = [&](const auto &change) {
    CaseSources sources = head.sources();
    change(sources);
    const auto created = create_case(head.scratch / "case", sources, false);
    EXPECT_FALSE(fs::exists(head.scratch / "case"));
    EXPECT_EQ(0, head.hidden_entries());
    return created ? std::string("made") : created.error().message;
  };
  EXPECT_EQ((head.scratch / "none.nii").string() + ": no such file or folder",
            message([&](CaseSources &s) { s.image = head.scratch / "none.nii"; }));
  EXPECT_EQ((head.scratch / "labels.nii.gz").string() + ": structure \"X\": there is no region \"Cuneus\" in " +
                (head.scratch / "labels.nii.txt").string(),
            message([](CaseSources &s) {
              s.structures = {{"X", {"Cuneus"}}};
            }));
  EXPECT_EQ((head.scratch / "labels.nii.gz").string() + ": surface \"X\": no voxel carries the label",
            message([](CaseSources &s) {
              s.structures = {{"X", {"12"}}};
            }));
  EXPECT_EQ((head.scratch / "head.nii.gz").string() + ": surface \"scalp\": no voxel is above the threshold of 200.000",
            message([](CaseSources &s) { s.scalp_threshold = 200.0; }));
  EXPECT_NE(std::string::npos, message([](CaseSources &s) { s.fiducials.clear(); }).find("fiducials"));
  EXPECT_NE(std::string::npos, message([](CaseSources &s) { s.tools.clear(); }).find("reference"));
  EXPECT_EQ("structures are asked for, but there is no label image", message([](CaseSources &s) { s.labels.clear(); }));
}

TEST(StructureRequests, AreParsed) {
  const auto both = parse_structure("Visual cortex=Calcarine_L,Calcarine_R");
  ASSERT_TRUE(both);
  EXPECT_EQ("Visual cortex", both->name);
  EXPECT_EQ((std::vector<std::string>{"Calcarine_L", "Calcarine_R"}), both->regions);
  EXPECT_EQ(std::vector<std::string>{"Insula_L"}, parse_structure("Insula_L")->regions);
  for (const char *bad : {"", "A=", "=B", "A=B,,C", "A=B,"}) {
    const auto refused = parse_structure(bad);
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ("structure \"" + std::string(bad) + "\": must be Region or Name=Region,Region,...",
              refused.error().message);
  }
}

// FreeSurfer's ASCII surfaces: a comment, counts, vertices with a flag, triangles with a flag.
surface::TriangleMesh read_ascii(const std::filesystem::path &file) {
  std::ifstream in(file);
  std::string comment;
  std::getline(in, comment);
  std::size_t vertices = 0;
  std::size_t triangles = 0;
  in >> vertices >> triangles;
  surface::TriangleMesh mesh;
  double flag = 0.0;
  for (std::size_t at = 0; at < vertices; ++at) {
    Eigen::Vector3d v;
    in >> v[0] >> v[1] >> v[2] >> flag;
    mesh.vertices_mm.push_back(v);
  }
  for (std::size_t at = 0; at < triangles; ++at) {
    Eigen::Vector3i t;
    in >> t[0] >> t[1] >> t[2] >> flag;
    mesh.triangles.push_back(t);
  }
  return mesh;
}

// A published surface of the same person by another method, relative to the centre of the same voxels.
void expect_near_published_skin(const surface::TriangleMesh &scalp, const Volume &image, const fs::path &file) {
  surface::TriangleMesh published = read_ascii(file);
  const Eigen::Vector3d middle = image.point_mm({90.5, 108.5, 90.5});
  for (Eigen::Vector3d &vertex : published.vertices_mm) {
    vertex += middle;
  }
  EXPECT_NEAR(4095.0, check_mesh(published).volume_ml, 1.0);
  EXPECT_NEAR(4095.0, check_mesh(scalp).volume_ml, 0.05 * 4095.0);
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3d &vertex : scalp.vertices_mm) {
    if (vertex.z() > -50.0) { // above the cut and the ears, which the other surface lacks
      points.push_back(vertex);
    }
  }
  const std::vector<Eigen::Vector3d> nearest = nearest_on_surface(published, points);
  std::vector<double> distances;
  for (std::size_t at = 0; at < points.size(); ++at) {
    distances.push_back((nearest[at] - points[at]).norm());
  }
  const auto median = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), median, distances.end());
  EXPECT_LT(*median, 2.0);
}

// The plan of the project, on its head.
TEST(Demonstration, IsACaseWithRoomAroundItsTrajectory) {
  if (!fs::exists(test::templates() / "ch2.nii.gz")) {
    GTEST_SKIP() << "needs mricron-data";
  }
  const fs::path plan = fs::path(BREGMA_SOURCE_DIR) / "demo/colin27";
  const TemporaryFolder scratch;
  CaseSources sources;
  sources.id = "colin27";
  sources.image = test::templates() / "ch2.nii.gz";
  sources.brain = test::templates() / "ch2bet.nii.gz";
  sources.labels = test::templates() / "aal.nii.gz";
  sources.fiducials = plan / "fiducials.mrk.json";
  sources.landmarks = plan / "landmarks.mrk.json";
  sources.targets = plan / "targets.mrk.json";
  sources.trajectories = plan / "trajectories.mrk.json";
  sources.tools = plan / "tools.toml";
  const auto created = create_case(scratch / "colin27", sources, false);
  ASSERT_TRUE(created) << created.error().message;
  const auto loaded = load_case(scratch / "colin27");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(8U, loaded->fiducials.size());
  EXPECT_EQ(3U, loaded->landmarks.size());
  EXPECT_EQ(6U, loaded->structures.size());
  for (const surface::TriangleMesh *mesh : {&loaded->scalp.mesh, &loaded->brain.mesh}) {
    EXPECT_EQ(10'000U, mesh->vertices_mm.size());
    EXPECT_EQ(2U * 10'000U - 4U, mesh->triangles.size()); // genus 0: no handle
    const MeshCheck check = check_mesh(*mesh);
    EXPECT_TRUE(check.closed && check.manifold && check.oriented);
    EXPECT_EQ(1, check.components);
  }
  for (const SurfaceSummary &surface : created->surfaces) {
    EXPECT_LT(surface.report.mean_distance_mm, 0.06) << surface.name;
    EXPECT_LT(surface.report.max_distance_mm, 0.6) << surface.name;
  }
  for (const auto *points : {&loaded->fiducials, &loaded->landmarks}) {
    for (const NamedPoint &point : *points) {
      EXPECT_LT(smallest_distance(loaded->scalp, {point.position_mm}), 0.2) << point.name;
    }
  }
  ASSERT_EQ(1U, loaded->trajectories.size());
  const Trajectory &path = loaded->trajectories.front();
  EXPECT_LT(smallest_distance(loaded->scalp, {path.entry_mm}), 1.0);
  EXPECT_LT((path.target_mm - loaded->targets.front().position_mm).norm(), 1e-6);
  std::vector<Eigen::Vector3d> along;
  for (int step = 0; step <= 200; ++step) {
    along.emplace_back(path.entry_mm + step / 200.0 * (path.target_mm - path.entry_mm));
  }
  for (const Surface &structure : loaded->structures) {
    EXPECT_GT(smallest_distance(structure, along), 10.0) << structure.name;
  }
  EXPECT_TRUE(encode_png(render(case_scene(*loaded, {0.75, 0.6, 0.45}, 300, 300))));

  const fs::path published = test::shared_data() / "meshes/colin27/colin27_outer_skin_surface.asc";
  if (!fs::exists(published)) {
    GTEST_SKIP() << "the comparison with a published surface needs " << published;
  }
  const auto image = read_volume(loaded->image);
  ASSERT_TRUE(image);
  expect_near_published_skin(loaded->scalp.mesh, *image, published);
}

} // namespace
} // namespace bregma::casefile
