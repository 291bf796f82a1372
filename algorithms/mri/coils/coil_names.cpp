#include "algorithms/mri/coils/coil_names.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::mri {

namespace {

struct Hypothesis {
  std::vector<int> coil; // of each sighting
  Rigid3<frame::Base, frame::Device> T;
  int named = 0;
  double rms_mm = 0.0;
};

bool better(const Hypothesis &a, const Hypothesis &b) {
  return a.named != b.named ? a.named > b.named : a.rms_mm < b.rms_mm;
}

constexpr int kMaxProposals = 10000;   // 16 coils in as many artefacts need 600, 24 in 16 need 3,200
constexpr std::size_t kMaxPerCoil = 4; // artefacts

class Search {
public:
  Search(const CoilFrame &coils, std::span<const std::vector<int>> on, std::span<const Sighting> sightings,
         const NamingOptions &options)
      : coils_(coils), on_(on), sightings_(sightings), options_(options) {}

  std::vector<Hypothesis> run() {
    const int n = static_cast<int>(sightings_.size());
    for (int a = 0; a < n && !exhausted(); ++a) {
      for (int b = a + 1; b < n; ++b) {
        for (const int i : allowed(a)) {
          for (const int j : allowed(b)) {
            if (i != j && agree(a, b, i, j)) {
              third(a, b, i, j);
            }
          }
        }
      }
    }
    std::stable_sort(found_.begin(), found_.end(), better);
    return found_;
  }

  [[nodiscard]] bool exhausted() const { return proposals_ > kMaxProposals; }

private:
  [[nodiscard]] const std::vector<int> &allowed(int sighting) const {
    return on_[static_cast<std::size_t>(sightings_[static_cast<std::size_t>(sighting)].scan)];
  }
  [[nodiscard]] const Vector3d &seen(int s) const { return sightings_[static_cast<std::size_t>(s)].position_mm; }
  [[nodiscard]] const Vector3d &drawn(int c) const { return coils_.coils[static_cast<std::size_t>(c)].position_mm; }
  [[nodiscard]] bool agree(int a, int b, int i, int j) const {
    const double distance = (drawn(i) - drawn(j)).norm();
    return distance >= options_.min_base_mm &&
           std::abs((seen(a) - seen(b)).norm() - distance) <= options_.max_distance_mm;
  }
  [[nodiscard]] bool known(int a, int b, int c, int i, int j, int k) const {
    return std::any_of(found_.begin(), found_.end(), [&](const Hypothesis &h) {
      return h.coil[static_cast<std::size_t>(a)] == i && h.coil[static_cast<std::size_t>(b)] == j &&
             h.coil[static_cast<std::size_t>(c)] == k;
    });
  }

  void third(int a, int b, int i, int j) {
    for (int c = b + 1; c < static_cast<int>(sightings_.size()) && !exhausted(); ++c) {
      for (const int k : allowed(c)) {
        if (k == i || k == j || !agree(a, c, i, k) || !agree(b, c, j, k) || known(a, b, c, i, j, k)) {
          continue;
        }
        const Vector3d side = drawn(j) - drawn(i);
        if (side.cross(drawn(k) - drawn(i)).norm() < 0.3 * options_.min_base_mm * side.norm()) {
          continue; // almost on a line
        }
        std::vector<int> start(sightings_.size(), -1);
        start[static_cast<std::size_t>(a)] = i;
        start[static_cast<std::size_t>(b)] = j;
        start[static_cast<std::size_t>(c)] = k;
        ++proposals_;
        if (auto h = grow(start)) {
          const bool repeated =
              std::any_of(found_.begin(), found_.end(), [&](const Hypothesis &other) { return other.coil == h->coil; });
          if (!repeated) {
            found_.push_back(std::move(*h));
          }
        }
      }
    }
  }

  // Fits the pose, names all artefacts by the nearest coil, and repeats until the names stay.
  std::optional<Hypothesis> grow(std::vector<int> names) const {
    for (int round = 0; round < 6; ++round) {
      const auto fitted = fit(names);
      if (!fitted) {
        return std::nullopt;
      }
      std::vector<int> next = nearest(fitted->T);
      if (next == names) {
        break;
      }
      names = std::move(next);
    }
    auto out = fit(names);
    return out && out->named >= 4 ? out : std::nullopt;
  }

  std::optional<Hypothesis> fit(const std::vector<int> &names) const {
    std::vector<Vector3d> source, target;
    for (std::size_t s = 0; s < names.size(); ++s) {
      if (names[s] >= 0) {
        source.push_back(sightings_[s].position_mm);
        target.push_back(drawn(names[s]));
      }
    }
    const auto T = registration::fit_rigid(source, target);
    if (!T) {
      return std::nullopt;
    }
    Hypothesis out{names, T->as<frame::Base, frame::Device>(), static_cast<int>(source.size()), 0.0};
    for (std::size_t i = 0; i < source.size(); ++i) {
      out.rms_mm += (*T * source[i] - target[i]).squaredNorm();
    }
    out.rms_mm = std::sqrt(out.rms_mm / static_cast<double>(source.size()));
    return out;
  }

  // Pairs by growing distance; each coil in each scan, and each artefact, once.
  std::vector<int> nearest(const Rigid3<frame::Base, frame::Device> &T) const {
    struct Pair {
      double distance;
      std::size_t sighting;
      int coil;
    };
    std::vector<Pair> pairs;
    for (std::size_t s = 0; s < sightings_.size(); ++s) {
      for (const int c : allowed(static_cast<int>(s))) {
        const double d = (T * sightings_[s].position_mm - drawn(c)).norm();
        if (d <= options_.tolerance_mm) {
          pairs.push_back({d, s, c});
        }
      }
    }
    std::stable_sort(pairs.begin(), pairs.end(), [](const Pair &a, const Pair &b) { return a.distance < b.distance; });
    std::vector<int> names(sightings_.size(), -1);
    std::vector<bool> used(coils_.coils.size(), false);
    for (const Pair &p : pairs) {
      if (names[p.sighting] < 0 && !used[static_cast<std::size_t>(p.coil)]) {
        names[p.sighting] = p.coil;
        used[static_cast<std::size_t>(p.coil)] = true;
      }
    }
    return names;
  }

  const CoilFrame &coils_;
  std::span<const std::vector<int>> on_;
  std::span<const Sighting> sightings_;
  const NamingOptions &options_;
  std::vector<Hypothesis> found_;
  int proposals_ = 0;
};

} // namespace

Naming name_coils(const CoilFrame &coils, std::span<const std::vector<int>> on, std::span<const Sighting> sightings,
                  const NamingOptions &options) {
  Naming out;
  out.coil.assign(sightings.size(), -1);
  std::size_t switched = 0;
  for (const std::vector<int> &scan : on) {
    switched += scan.size();
  }
  if (sightings.size() > kMaxPerCoil * switched) {
    out.status = Naming::Status::kTooMany;
    return out;
  }
  Search search(coils, on, sightings, options);
  const std::vector<Hypothesis> found = search.run();
  if (search.exhausted()) {
    out.status = Naming::Status::kTooMany;
    return out;
  }
  if (!found.empty()) {
    const Hypothesis &best = found.front();
    out.coil = best.coil;
    out.T_base_device = best.T;
    out.rms_mm = best.rms_mm;
    out.named = best.named;
    out.status = Naming::Status::kNamed;
    // With few coils a smaller pattern that fits as well is a rival too.
    for (std::size_t i = 1; i < found.size() && found[i].named == best.named; ++i) {
      if (out.rival_rms_mm == 0.0) {
        out.rival_rms_mm = found[i].rms_mm;
      }
    }
    if (out.rival_rms_mm > 0.0 && out.rival_rms_mm <= best.rms_mm + options.rival_mm) {
      out.status = Naming::Status::kAmbiguous;
    }
  }
  for (const std::vector<int> &scan : on) {
    for (const int c : scan) {
      const bool seen = std::find(out.coil.begin(), out.coil.end(), c) != out.coil.end();
      if (!seen && std::find(out.missing.begin(), out.missing.end(), c) == out.missing.end()) {
        out.missing.push_back(c);
      }
    }
  }
  return out;
}

} // namespace bregma::mri
