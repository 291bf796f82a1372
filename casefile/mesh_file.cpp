#include "casefile/mesh_file.hpp"

#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <unordered_map>

#include <Eigen/Geometry>

#include "base/read_file.hpp"
#include "base/write_file.hpp"
#include "casefile/ply.hpp"

namespace bregma::casefile {

namespace {

using surface::TriangleMesh;

std::string mesh_problem(const TriangleMesh &mesh) {
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    if (!mesh.vertices_mm[i].allFinite()) {
      return "vertex " + std::to_string(i) + " is not finite";
    }
  }
  const auto count = static_cast<int>(mesh.vertices_mm.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Eigen::Vector3i &t = mesh.triangles[i];
    if (t.minCoeff() < 0 || t.maxCoeff() >= count) {
      return "triangle " + std::to_string(i) + " refers to a vertex that does not exist";
    }
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      return "triangle " + std::to_string(i) + " has a vertex twice";
    }
  }
  return {};
}

double volume_mm3(const TriangleMesh &mesh) {
  double six_volumes = 0.0;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const auto &v = mesh.vertices_mm;
    const auto at = [&](int corner) { return v[static_cast<std::size_t>(t[corner])] - v.front(); };
    const Eigen::Vector3d a = at(0);
    const Eigen::Vector3d b = at(1);
    const Eigen::Vector3d c = at(2);
    six_volumes += a.dot(b.cross(c));
  }
  return six_volumes / 6.0;
}

} // namespace

base::Result<TriangleMesh> read_mesh(const std::filesystem::path &file) {
  const auto content = base::read_file(file);
  if (!content) {
    return tl::unexpected(content.error());
  }
  auto mesh = detail::parse_ply(*content);
  const std::string problem = !mesh ? mesh.error() : mesh->triangles.empty() ? "holds no surface" : mesh_problem(*mesh);
  if (!problem.empty()) {
    return base::failure(file.string() + ": " + problem);
  }
  return std::move(*mesh);
}

base::Result<void> write_mesh(const std::filesystem::path &file, const TriangleMesh &mesh) {
  if (const std::string problem = mesh_problem(mesh); !problem.empty()) {
    return base::failure(file.string() + ": not written: " + problem);
  }
  return base::write_file(file, detail::to_ply(mesh));
}

base::Result<void> write_stl(const std::filesystem::path &file, const TriangleMesh &mesh) {
  if (const std::string problem = mesh_problem(mesh); !problem.empty()) {
    return base::failure(file.string() + ": not written: " + problem);
  }
  std::string bytes = "Bregma, mm; SPACE=RAS";
  bytes.resize(80, ' ');
  const auto put = [&bytes](auto value) {
    std::array<char, sizeof value> raw{};
    std::memcpy(raw.data(), &value, sizeof value);
    bytes.append(raw.data(), raw.size());
  };
  put(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const auto at = [&](int corner) { return mesh.vertices_mm[static_cast<std::size_t>(t[corner])]; };
    const Eigen::Vector3d normal = (at(1) - at(0)).cross(at(2) - at(0)).normalized();
    for (const Eigen::Vector3d &vector : {normal, at(0), at(1), at(2)}) {
      for (const double coordinate : vector) {
        put(static_cast<float>(coordinate));
      }
    }
    put(std::uint16_t{0});
  }
  return base::write_file(file, bytes);
}

base::Result<void> check_closed(const TriangleMesh &mesh) {
  if (mesh.triangles.empty()) {
    return base::failure("the surface is empty");
  }
  if (const std::string problem = mesh_problem(mesh); !problem.empty()) {
    return base::failure(problem);
  }
  // Every directed edge occurs once, and its opposite occurs once.
  const auto key = [](int from, int to) {
    return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(from)) << 32U) | static_cast<std::uint32_t>(to);
  };
  std::unordered_map<std::uint64_t, int> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) {
      if (++edges[key(t[i], t[(i + 1) % 3])] > 1) {
        return base::failure("the surface is not oriented: two triangles run along the edge of vertices " +
                             std::to_string(t[i]) + " and " + std::to_string(t[(i + 1) % 3]) +
                             " in the same direction");
      }
    }
  }
  std::size_t open = 0;
  for (const auto &[edge, count] : edges) {
    const std::uint64_t back = (edge << 32U) | (edge >> 32U);
    open += edges.contains(back) ? 0 : 1;
  }
  if (open > 0) {
    return base::failure("the surface is not closed: " + std::to_string(open) + " edges belong to one triangle only");
  }
  if (const double volume = volume_mm3(mesh); !(volume > 0.0)) {
    return base::failure("the triangles of the surface face inwards");
  }
  return {};
}

} // namespace bregma::casefile
