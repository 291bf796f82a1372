#include "clients/cli/report/scalp_residuals.hpp"

#include <algorithm>
#include <optional>
#include <stdexcept>

#include "algorithms/surface/surface_model.hpp"
#include "casefile/mesh_file.hpp"
#include "clients/cli/report/attached_file.hpp"
#include "idl/names.hpp"

namespace bregma::cli::report {
namespace {

using base::Result;

Result<surface::TriangleMesh> attached_mesh(const casefile::SessionReader &reader, const std::string &name) {
  const auto file = AttachedFile::write(reader, name, ".ply");
  if (!file) {
    return tl::unexpected(file.error());
  }
  return casefile::read_mesh(file->path()).map_error([&](const base::Error &error) {
    return base::Error{"attachment " + name + ": " + error.message};
  });
}

} // namespace

Result<void> measure_trace(const casefile::SessionReader &reader, const wire::RegistrationState &accepted,
                           std::int64_t since_ns, SessionAnalysis &out) {
  const auto names = reader.attachments();
  if (!names) {
    return tl::unexpected(names.error());
  }
  const auto name = std::find_if(names->begin(), names->end(), [](const std::string &one) {
    return std::filesystem::path(one).filename() == kScalpAttachment;
  });
  if (name == names->end()) {
    return {};
  }
  auto mesh = attached_mesh(reader, *name);
  if (!mesh) {
    return tl::unexpected(mesh.error());
  }
  out.scalp = std::move(*mesh);
  std::optional<surface::SurfaceModel> model;
  try {
    model.emplace(out.scalp);
  } catch (const std::invalid_argument &error) {
    return base::failure("attachment " + *name + ": " + error.what());
  }
  const auto T_image_reference =
      wire::from_wire<geometry::frame::Image, geometry::frame::Reference>(accepted.accepted_T_image_reference);
  const std::int64_t accepted_ns = out.registration->accepted_time_ns;
  return reader
      .each<wire::CapturedPoint>([&](const wire::CapturedPoint &sample, std::int64_t time_ns) {
        if (sample.kind != bregma_wire_CAPTURE_SURFACE || time_ns < since_ns || time_ns > accepted_ns) {
          return;
        }
        const Eigen::Vector3d point = T_image_reference * Eigen::Vector3d(sample.position_mm);
        if (point.allFinite()) {
          const auto closest = model->closest(point);
          out.trace.push_back({closest.point_mm, closest.signed_mm});
        }
      })
      .map([](std::size_t) {});
}

} // namespace bregma::cli::report
