#include "casefile/volumes/case_builder.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include <Eigen/Geometry>

#include "casefile/markups.hpp"
#include "casefile/volumes/label_check.hpp"
#include "casefile/volumes/label_regions.hpp"
#include "casefile/volumes/partial_folder.hpp"
#include "casefile/volumes/patient.hpp"
#include "casefile/volumes/second_image.hpp"
#include "casefile/volumes/structures.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

// Fraction of the total time per part, measured on the demonstration's head.
constexpr double kScalpShare = 0.45;
constexpr double kBrainShare = 0.25;

class CaseMaker {
public:
  CaseMaker(const CaseSources &sources, const Progress &progress) : sources_(sources), progress_(progress) {}

  base::Result<CreatedCase> make(const fs::path &folder) {
    created_.value.id = sources_.id;
    created_.value.folder = folder;
    for (const auto stage : {&CaseMaker::read_plans, &CaseMaker::keep_labels, &CaseMaker::make_scalp,
                             &CaseMaker::make_brain, &CaseMaker::make_structures, &CaseMaker::snap}) {
      if (auto done = (this->*stage)(); !done) {
        return with_notes(done.error());
      }
    }
    if (auto sound = check_case(created_.value); !sound) {
      return with_notes(sound.error());
    }
    if (auto saved = save_case(created_.value); !saved) {
      return tl::unexpected(saved.error());
    }
    if (auto kept = keep_patient(); !kept) {
      return tl::unexpected(kept.error());
    }
    return std::move(created_);
  }

private:
  // What was assumed may be the cause.
  [[nodiscard]] tl::unexpected<base::Error> with_notes(const base::Error &error) const {
    std::string message = error.message;
    for (const std::string &note : created_.notes) {
      message += "; note that " + note;
    }
    return base::failure(std::move(message));
  }

  // Checks the plan before the long computation.
  base::Result<void> read_plans() {
    Case &c = created_.value;
    for (const auto &[file, points] : {std::pair{&sources_.fiducials, &c.fiducials},
                                       {&sources_.landmarks, &c.landmarks},
                                       {&sources_.brain_landmarks, &c.brain_landmarks},
                                       {&sources_.targets, &c.targets}}) {
      if (file->empty()) {
        continue;
      }
      auto read = read_points(*file, &created_.notes);
      if (!read) {
        return tl::unexpected(read.error());
      }
      *points = std::move(*read);
    }
    if (!sources_.trajectories.empty()) {
      auto read = read_trajectories(sources_.trajectories, &created_.notes);
      if (!read) {
        return tl::unexpected(read.error());
      }
      c.trajectories = std::move(*read);
      if (!c.trajectories.empty() && !sources_.brain.empty()) {
        c.craniotomy = {.trajectory = c.trajectories.front().name, .radius_mm = std::nullopt};
      }
    }
    if (!sources_.tools.empty()) {
      auto read = read_tools(sources_.tools);
      if (!read) {
        return tl::unexpected(read.error());
      }
      c.tools = std::move(*read);
    }
    return StructureMaker::read({sources_.labels, sources_.label_names, sources_.structures}, sources_.space,
                                &created_.notes)
        .map([this](StructureMaker &&structures) { structures_ = std::move(structures); });
  }

  base::Result<void> keep_patient() {
    const auto patient = sources_.anonymous ? std::nullopt : read_patient(sources_.image, sources_.series);
    created_.has_patient = patient.has_value();
    return patient ? write_patient(created_.value.folder, *patient) : base::Result<void>();
  }

  base::Result<void> keep_labels() {
    const LabelRegions regions = structures_.regions();
    if (regions.empty()) {
      return {};
    }
    const fs::path &folder = created_.value.folder;
    const LabelVolume &labels = structures_.labels();
    const Volume volume{{labels.size, labels.T_image_index}, {labels.voxels.begin(), labels.voxels.end()}};
    auto stored = store_image(sources_.labels, volume, folder / "labels");
    if (!stored) {
      return tl::unexpected(stored.error());
    }
    created_.value.labels = LabelImage{std::move(*stored), folder / "labels.txt"};
    return write_label_regions(created_.value.labels->table, regions);
  }

  base::Result<void> make_scalp() {
    const auto image =
        read_volume(sources_.image, {.series = sources_.series, .space = sources_.space}, &created_.notes);
    if (!image) {
      return tl::unexpected(image.error());
    }
    // A file that does not state its space is written anew, with the one that was taken.
    auto stored = store_image(sources_.image, *image, created_.value.folder / "image");
    if (!stored) {
      return tl::unexpected(stored.error());
    }
    created_.value.image = std::move(*stored);
    for (const std::string &doubt : structures_.doubts(*image)) {
      created_.notes.push_back(doubt);
    }
    image_grid_ = {{image->size, image->T_image_index}, {}};
    SurfaceOptions options = scalp_options();
    options.threshold = sources_.scalp_threshold;
    options.vertices = sources_.vertices;
    return keep(extract_surface(*image, options, within(progress_, 0.0, kScalpShare, "scalp")), "scalp", sources_.image,
                created_.value.scalp);
  }

  base::Result<void> make_brain() {
    if (sources_.brain.empty()) {
      return {};
    }
    const auto image = read_volume(sources_.brain, {.space = sources_.space}, &created_.notes);
    if (!image) {
      return tl::unexpected(image.error());
    }
    if (!same_grid(*image, image_grid_)) {
      created_.notes.push_back(sources_.brain.string() +
                               ": the brain lies on another grid than the image: was it made from it?");
    }
    SurfaceOptions options;
    options.threshold = 0.0;
    options.closing_mm = 2.0; // narrow sulci
    options.vertices = sources_.vertices;
    return keep(extract_surface(*image, options, within(progress_, kScalpShare, kScalpShare + kBrainShare, "brain")),
                "brain", sources_.brain, created_.value.brain);
  }

  base::Result<void> make_structures() {
    auto made =
        structures_.make(std::max(100, sources_.vertices / 2), within(progress_, kScalpShare + kBrainShare, 1.0, ""));
    if (!made) {
      return tl::unexpected(made.error());
    }
    created_.value.structures = std::move(made->surfaces);
    created_.surfaces.insert(created_.surfaces.end(), made->summaries.begin(), made->summaries.end());
    return {};
  }

  base::Result<void> snap() {
    for (auto *points : {&created_.value.fiducials, &created_.value.landmarks}) {
      if (!sources_.snap) {
        continue;
      }
      if (auto moved = snap_points(*points, created_.value.scalp, kMaxSnap_mm); !moved) {
        return tl::unexpected(moved.error());
      }
    }
    return {};
  }

  base::Result<void> keep(base::Result<ExtractedSurface> extracted, const std::string &name, const fs::path &source,
                          Surface &surface) {
    auto named = named_surface(std::move(extracted), name, source);
    if (!named) {
      return tl::unexpected(named.error());
    }
    surface = std::move(named->first);
    created_.surfaces.push_back(std::move(named->second));
    return {};
  }

  const CaseSources &sources_;
  const Progress &progress_;
  CreatedCase created_;
  StructureMaker structures_;
  Volume image_grid_; // without voxels
};

} // namespace

base::Result<CreatedCase> create_case(const fs::path &folder, const CaseSources &sources, bool replace,
                                      const Progress &progress) {
  auto partial = PartialFolder::next_to(folder, replace);
  if (!partial) {
    return tl::unexpected(partial.error());
  }
  auto created = CaseMaker(sources, progress).make(partial->path());
  if (!created) {
    return created;
  }
  if (progress && !progress(1.0, "done")) {
    return base::failure("stopped");
  }
  if (auto placed = partial->put_in_place(); !placed) {
    return tl::unexpected(placed.error());
  }
  created->value.folder = partial->final_path();
  created->value.image = partial->final_path() / created->value.image.filename();
  if (auto &labels = created->value.labels) {
    labels->file = partial->final_path() / labels->file.filename();
    labels->table = partial->final_path() / labels->table.filename();
  }
  return created;
}

base::Result<std::vector<SnappedPoint>> snap_points(std::vector<NamedPoint> &points, const Surface &surface,
                                                    double max_mm) {
  std::vector<Eigen::Vector3d> places;
  places.reserve(points.size());
  for (const NamedPoint &point : points) {
    places.push_back(point.position_mm);
  }
  const std::vector<Eigen::Vector3d> nearest = nearest_on_surface(surface.mesh, places);
  std::vector<SnappedPoint> moves;
  std::vector<NamedPoint> snapped = points;
  for (std::size_t at = 0; at < points.size(); ++at) {
    moves.push_back({points[at].name, (nearest[at] - places[at]).norm()});
    if (!(moves.back().moved_mm <= max_mm)) {
      std::array<char, 64> text{};
      std::snprintf(text.data(), text.size(), "%.1f mm", moves.back().moved_mm);
      return base::failure("\"" + points[at].name + "\" lies " + text.data() + " from the " + surface.name +
                           ", too far to be moved onto it");
    }
    snapped[at].position_mm = nearest[at];
  }
  points = std::move(snapped);
  return moves;
}

} // namespace bregma::casefile
