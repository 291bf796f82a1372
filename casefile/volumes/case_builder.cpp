#include "casefile/volumes/case_builder.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <limits>
#include <map>

#include <Eigen/Geometry>

#include "base/text.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/label_check.hpp"
#include "casefile/volumes/label_names.hpp"
#include "casefile/volumes/label_regions.hpp"
#include "casefile/volumes/partial_folder.hpp"
#include "casefile/volumes/patient.hpp"
#include "casefile/volumes/second_image.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

// Fraction of the total time per part, measured on the demonstration's head.
constexpr double kScalpShare = 0.45;
constexpr double kBrainShare = 0.25;

Progress within(const Progress &progress, double from, double to, const std::string &what) {
  if (!progress) {
    return {};
  }
  return [&progress, from, to, what](double done, std::string_view stage) {
    return progress(from + (to - from) * done, what + ": " + std::string(stage));
  };
}

std::optional<std::int16_t> region_number(const std::string &region, const LabelNames &names) {
  for (const auto &[value, name] : names) {
    if (name == region && value > 0 && value <= std::numeric_limits<std::int16_t>::max()) {
      return static_cast<std::int16_t>(value);
    }
  }
  const auto value = base::parsed_number<std::int16_t>(region);
  return value && *value > 0 ? value : std::nullopt;
}

fs::path label_table_of(const fs::path &labels) {
  fs::path table = labels;
  if (table.extension() == ".gz") {
    table.replace_extension();
  }
  return table += ".txt";
}

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
    return read_label_image();
  }

  base::Result<void> read_label_image() {
    if (sources_.labels.empty()) {
      return sources_.structures.empty() ? base::Result<void>()
                                         : base::failure("structures are asked for, but there is no label image");
    }
    auto labels = read_labels(sources_.labels, {.space = sources_.space}, &created_.notes);
    if (!labels) {
      return tl::unexpected(labels.error());
    }
    labels_ = std::move(*labels);
    if (auto names = read_names(); !names) {
      return names;
    }
    for (const StructureRequest &request :
         sources_.structures.empty() ? critical_structures(names_) : sources_.structures) {
      std::vector<std::int16_t> regions;
      for (const std::string &region : request.regions) {
        const auto number = region_number(region, names_);
        if (!number) {
          return base::failure(sources_.labels.string() + ": structure \"" + request.name +
                               "\": there is no region \"" + region + "\" in " +
                               (names_.empty() ? "it; no names are known" : names_from_));
        }
        regions.push_back(*number);
      }
      structures_.emplace_back(request.name, std::move(regions));
    }
    return {};
  }

  base::Result<void> keep_patient() {
    const auto patient = sources_.anonymous ? std::nullopt : read_patient(sources_.image, sources_.series);
    created_.has_patient = patient.has_value();
    return patient ? write_patient(created_.value.folder, *patient) : base::Result<void>();
  }

  base::Result<void> keep_labels() {
    const LabelRegions regions = regions_in(labels_, names_, colours_);
    if (regions.empty()) {
      return {};
    }
    const fs::path &folder = created_.value.folder;
    const Volume volume{{labels_.size, labels_.T_image_index}, {labels_.voxels.begin(), labels_.voxels.end()}};
    auto stored = store_image(sources_.labels, volume, folder / "labels");
    if (!stored) {
      return tl::unexpected(stored.error());
    }
    created_.value.labels = LabelImage{std::move(*stored), folder / "labels.txt"};
    return write_label_regions(created_.value.labels->table, regions);
  }

  // Of a known atlas, of the file that is given, or of one beside the labels.
  base::Result<void> read_names() {
    if (auto known = known_label_names(sources_.label_names.string())) {
      names_ = std::move(*known);
      names_from_ = "the atlas " + sources_.label_names.string();
      return {};
    }
    std::error_code ignored;
    const bool given = !sources_.label_names.empty();
    const fs::path file = given ? sources_.label_names : label_table_of(sources_.labels);
    names_from_ = file.string();
    if (!given && !fs::exists(file, ignored)) {
      return {};
    }
    auto names = read_label_names(file);
    if (!names) {
      return tl::unexpected(names.error());
    }
    names_ = std::move(*names);
    colours_ = read_label_colours(file);
    return {};
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
    if (!structures_.empty()) {
      for (const std::string &doubt : label_doubts(labels_, names_, *image)) {
        created_.notes.push_back(sources_.labels.string() + ": the labels " + doubt);
      }
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
    SurfaceOptions options;
    options.closing_mm = 1.0;
    options.blur_mm = 0.7; // more blur would erode thin gyri
    options.vertices = std::max(100, sources_.vertices / 2);
    const double start = kScalpShare + kBrainShare;
    const double share = (1.0 - start) / static_cast<double>(std::max<std::size_t>(structures_.size(), 1));
    double from = start;
    for (const auto &[name, regions] : structures_) {
      Surface surface;
      if (auto kept = keep(extract_surface(labels_, regions, options, within(progress_, from, from + share, name)),
                           name, sources_.labels, surface);
          !kept) {
        return kept;
      }
      created_.value.structures.push_back(std::move(surface));
      from += share;
    }
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
    if (!extracted) {
      return base::failure(source.string() + ": surface \"" + name + "\": " + extracted.error().message);
    }
    surface = {name, std::move(extracted->mesh)};
    created_.surfaces.push_back({name, static_cast<int>(surface.mesh.vertices_mm.size()), extracted->report});
    return {};
  }

  const CaseSources &sources_;
  const Progress &progress_;
  CreatedCase created_;
  LabelVolume labels_;
  Volume image_grid_; // without voxels
  LabelNames names_;
  LabelColours colours_;
  std::string names_from_;
  std::vector<std::pair<std::string, std::vector<std::int16_t>>> structures_;
};

} // namespace

base::Result<StructureRequest> parse_structure(const std::string &text) {
  StructureRequest request;
  const std::size_t equals = text.find('=');
  request.name = text.substr(0, equals);
  const std::string regions = equals == std::string::npos ? text : text.substr(equals + 1);
  for (std::size_t from = 0; from <= regions.size();) {
    const std::size_t comma = std::min(regions.find(',', from), regions.size());
    request.regions.push_back(regions.substr(from, comma - from));
    from = comma + 1;
  }
  const bool empty =
      std::any_of(request.regions.begin(), request.regions.end(), [](const auto &r) { return r.empty(); });
  if (request.name.empty() || empty) {
    return base::failure("structure \"" + text + "\": must be Region or Name=Region,Region,...");
  }
  return request;
}

std::vector<StructureRequest> critical_structures(const LabelNames &names) {
  struct Atlas {
    // Of a region's name, around its own: the left and the right side.
    std::array<std::string, 2> before, after;
    std::vector<StructureRequest> kinds;
  };
  const std::array<Atlas, 4> atlases{
      {{{"", ""},
        {"_L", "_R"},
        {{"Precentral gyrus", {"Precentral"}},
         {"Occipital lobe", {"Calcarine", "Cuneus", "Lingual", "Occipital_Sup", "Occipital_Mid", "Occipital_Inf"}},
         {"Heschl gyrus", {"Heschl"}}}},
       {{"ctx-lh-", "ctx-rh-"},
        {"", ""},
        {{"Precentral gyrus", {"precentral"}},
         {"Occipital lobe", {"lateraloccipital", "cuneus", "pericalcarine", "lingual"}},
         {"Heschl gyrus", {"transversetemporal"}}}},
       {{"Left ", "Right "},
        {"", ""},
        {{"Precentral gyrus", {"PrG precentral gyrus"}},
         {"Occipital lobe",
          {"Calc calcarine cortex", "Cun cuneus", "LiG lingual gyrus", "IOG inferior occipital gyrus",
           "MOG middle occipital gyrus", "OCP occipital pole", "SOG superior occipital gyrus"}},
         {"Heschl gyrus", {"TTG transverse temporal gyrus"}}}},
       {{"", ""},
        {"_l", "_r"},
        {{"Precentral gyrus", {"FL_precen_G"}}, {"Occipital lobe", {"OL_rest_lat", "OL_ling_G", "OL_cuneus"}}}}}};
  const auto has = [&names](const std::string &region) {
    return std::any_of(names.begin(), names.end(), [&region](const auto &entry) { return entry.second == region; });
  };
  const auto found = std::find_if(atlases.begin(), atlases.end(), [&has](const Atlas &atlas) {
    return has(atlas.before[0] + atlas.kinds.front().regions.front() + atlas.after[0]);
  });
  const Atlas &atlas = found != atlases.end() ? *found : atlases.front();
  std::vector<StructureRequest> requests;
  for (const StructureRequest &kind : atlas.kinds) {
    for (const std::size_t side : {0U, 1U}) {
      StructureRequest request{kind.name + (side == 0 ? " L" : " R"), kind.regions};
      for (std::string &region : request.regions) {
        region = atlas.before[side] + region + atlas.after[side];
      }
      requests.push_back(std::move(request));
    }
  }
  return requests;
}

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
