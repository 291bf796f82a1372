// Reads curves from files. markups.cpp reads the points of Slicer's files; tables are read here.
#include <map>

#include "base/text.hpp"
#include "casefile/markups.hpp"
#include "casefile/point_table.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;

// Two marks that are nearer to each other than this count as one mark, set twice.
constexpr double kSameMark_mm = 1e-6;

// The curve of the given points, or the reason why they are not a curve.
base::Result<MarkedCurve> curve_of(const fs::path &file, std::string name, std::vector<Eigen::Vector3d> points,
                                   bool closed) {
  const std::string place = file.string() + ": curve \"" + name + "\": ";
  const auto same = [&points](std::size_t a, std::size_t b) { return (points[a] - points[b]).norm() < kSameMark_mm; };
  if (points.size() > 3 && same(0, points.size() - 1)) {
    closed = true;
    points.pop_back();
  }
  if (const std::size_t needed = closed ? 3 : 2; points.size() < needed) {
    return base::failure(place + "has " + std::to_string(points.size()) + " points, a " + (closed ? "closed " : "") +
                         "curve has at least " + std::to_string(needed));
  }
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (same(i - 1, i)) {
      return base::failure(place + "points " + std::to_string(i) + " and " + std::to_string(i + 1) + " are the same");
    }
  }
  return MarkedCurve{std::move(name), std::move(points), closed};
}

struct TableCurve {
  std::string name;
  std::vector<Eigen::Vector3d> points;
};

base::Result<std::vector<TableCurve>> read_table(const fs::path &file, Notes *notes) {
  const auto table = read_point_table(file, {.curves = true});
  if (!table) {
    return tl::unexpected(table.error());
  }
  if (notes != nullptr) {
    notes->insert(notes->end(), table->notes.begin(), table->notes.end());
  }
  std::vector<TableCurve> out;
  std::map<std::string, std::size_t, std::less<>> index;
  for (const TablePoint &point : table->points) {
    if (point.curve.empty()) {
      return base::failure(file.string() + ": point " + point.name +
                           " has no curve: the columns must be \"curve,x,y,z\"");
    }
    const auto [entry, fresh] = index.try_emplace(point.curve, out.size());
    if (fresh) {
      out.push_back({point.curve, {}});
    }
    out[entry->second].points.push_back(point.position_mm);
  }
  return out;
}

} // namespace

base::Result<std::vector<MarkedCurve>> read_curves(const fs::path &file, Notes *notes) {
  std::vector<MarkedCurve> out;
  std::map<std::string, int, std::less<>> names;
  const auto keep = [&](std::string name, std::vector<Eigen::Vector3d> points, bool closed) -> base::Result<void> {
    if (++names[name] > 1) {
      return base::failure(file.string() + ": two curves are called \"" + name + "\"");
    }
    auto curve = curve_of(file, std::move(name), std::move(points), closed);
    if (!curve) {
      return tl::unexpected(curve.error());
    }
    out.push_back(std::move(*curve));
    return {};
  };
  if (is_point_table(file)) {
    auto table = read_table(file, notes);
    if (!table) {
      return tl::unexpected(table.error());
    }
    for (TableCurve &curve : *table) {
      if (auto kept = keep(std::move(curve.name), std::move(curve.points), false); !kept) {
        return tl::unexpected(kept.error());
      }
    }
  } else {
    const auto markups = read_markups(file, notes);
    if (!markups) {
      return tl::unexpected(markups.error());
    }
    for (const Markup &markup : *markups) {
      if (markup.kind == Markup::Kind::kPoints) {
        return base::failure(file.string() + ": \"" + markup.name + "\" is a list of points where curves are expected");
      }
      std::vector<Eigen::Vector3d> points;
      for (const NamedPoint &point : markup.points) {
        points.push_back(point.position_mm);
      }
      // A single unnamed curve is named after its file.
      const std::string name = markup.name.empty() ? file.stem().stem().string() : markup.name;
      if (auto kept = keep(name, std::move(points), markup.kind == Markup::Kind::kClosedCurve); !kept) {
        return tl::unexpected(kept.error());
      }
    }
  }
  return out.empty() ? base::Result<std::vector<MarkedCurve>>(base::failure(file.string() + ": holds no curve")) : out;
}

} // namespace bregma::casefile
