#include "bench/accuracy/registration_peer.hpp"

#ifdef BREGMA_BENCH_PCL
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
#include <pcl/search/kdtree.h>
#endif

namespace bregma::bench {

#ifdef BREGMA_BENCH_PCL

namespace {
using Point = pcl::PointNormal;
constexpr int kPeerIterations = 50;
constexpr double kPeerReach_mm = 60.0; // larger than the distance of any sample at starts 20 degrees and 20 mm off
constexpr double kPeerSettled = 1e-6;
} // namespace

struct PclIcp::Parts {
  pcl::PointCloud<Point>::Ptr target = std::make_shared<pcl::PointCloud<Point>>();
  pcl::search::KdTree<Point>::Ptr tree = std::make_shared<pcl::search::KdTree<Point>>();
  pcl::IterativeClosestPointWithNormals<Point, Point> icp;
};

bool PclIcp::available() { return true; }

PclIcp::PclIcp(const Head &head) : parts_(std::make_unique<Parts>()) {
  std::vector<Vector3d> normals(head.mesh.vertices_mm.size(), Vector3d::Zero());
  const auto at = [](int i) { return static_cast<std::size_t>(i); };
  for (const Eigen::Vector3i &t : head.mesh.triangles) {
    const Vector3d &a = head.mesh.vertices_mm[at(t[0])];
    const Vector3d normal = (head.mesh.vertices_mm[at(t[1])] - a).cross(head.mesh.vertices_mm[at(t[2])] - a);
    for (int k = 0; k < 3; ++k) {
      normals[at(t[k])] += normal;
    }
  }
  for (std::size_t i = 0; i < normals.size(); ++i) {
    Point point;
    point.getVector3fMap() = head.mesh.vertices_mm[i].cast<float>();
    point.getNormalVector3fMap() = normals[i].normalized().cast<float>();
    parts_->target->push_back(point);
  }
  parts_->tree->setInputCloud(parts_->target);
  parts_->icp.setSearchMethodTarget(parts_->tree, true);
  parts_->icp.setInputTarget(parts_->target);
  parts_->icp.setMaximumIterations(kPeerIterations);
  parts_->icp.setMaxCorrespondenceDistance(kPeerReach_mm);
  parts_->icp.setTransformationEpsilon(kPeerSettled);
}

PairedPose PclIcp::fit(std::span<const Vector3d> source_mm, const PairedPose &start) {
  auto source = std::make_shared<pcl::PointCloud<Point>>();
  for (const Vector3d &p : source_mm) {
    Point point;
    point.getVector3fMap() = p.cast<float>();
    source->push_back(point);
  }
  parts_->icp.setInputSource(source);
  pcl::PointCloud<Point> aligned;
  parts_->icp.align(aligned, start.matrix().cast<float>());
  const Eigen::Matrix4d T = parts_->icp.getFinalTransformation().cast<double>();
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  return {R, T.topRightCorner<3, 1>()};
}

#else

struct PclIcp::Parts {};
bool PclIcp::available() { return false; }
PclIcp::PclIcp(const Head & /*head*/) {}
PairedPose PclIcp::fit(std::span<const Vector3d> /*source_mm*/, const PairedPose &start) { return start; }

#endif

PclIcp::~PclIcp() = default;
PclIcp::PclIcp(PclIcp &&) noexcept = default;
PclIcp &PclIcp::operator=(PclIcp &&) noexcept = default;

} // namespace bregma::bench
