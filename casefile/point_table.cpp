#include "casefile/point_table.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include <Eigen/Cholesky>

#include "base/csv_table.hpp"
#include "base/text.hpp"
#include "casefile/point_columns.hpp"

namespace bregma::casefile {
namespace {

using base::CsvRow;
using base::CsvTable;
using detail::Column;
using detail::Layout;
using detail::Meaning;

std::optional<bool> truth_of(const std::string &cell) {
  const std::string text = base::lower(cell);
  const bool yes = text == "1" || text == "true" || text == "yes" || text == "2"; // 2: Slicer's PositionDefined
  const bool no = text == "0" || text == "false" || text == "no";
  return yes || no ? std::optional(yes) : std::nullopt;
}

class Reader {
public:
  Reader(const CsvTable &table, const Layout &layout, const PointTableOptions &options)
      : table_(table), layout_(layout), scale_(mm_per(layout.unit().value_or(options.unit))) {
    const bool lps = layout.has(Meaning::kTime) || options.space == Space::kLps;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const Column &column = layout.columns()[layout.at(static_cast<Meaning>(axis))];
      signs_[axis] = column.space_stated ? column.sign : lps && axis < 2 ? -1.0 : 1.0;
    }
  }

  // index: from 1, the name of a point without one.
  [[nodiscard]] std::string name(const CsvRow &row, std::size_t index) const {
    const std::string stated = cell(row, Meaning::kName).empty() ? cell(row, Meaning::kId) : cell(row, Meaning::kName);
    return stated.empty() ? std::to_string(index) : stated;
  }

  // Empty: the point was never placed.
  [[nodiscard]] base::Result<std::optional<TablePoint>> read(const CsvRow &row, std::size_t index) const {
    TablePoint out;
    out.name = name(row, index);
    out.curve = cell(row, Meaning::kCurve);
    const std::string place = table_.place(row) + "point " + out.name + ": ";
    if (row.cells.size() != layout_.columns().size()) {
      return base::failure(table_.place(row) + "has " + std::to_string(row.cells.size()) + " cells, there are " +
                           std::to_string(layout_.columns().size()) + " columns");
    }
    if (layout_.has(Meaning::kDefined)) {
      const std::string text = cell(row, Meaning::kDefined);
      const auto defined = truth_of(text);
      if (!defined) {
        return base::failure(place + layout_.columns()[layout_.at(Meaning::kDefined)].word + " = \"" + text +
                             "\": must be 1 or 0: was the point placed?");
      }
      if (!*defined) {
        return std::nullopt;
      }
    }
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const auto value = number(row, static_cast<Meaning>(axis), place);
      if (!value) {
        return tl::unexpected(value.error());
      }
      out.position_mm[axis] = scale_ * signs_[axis] * *value;
    }
    auto covariance = covariance_of(row, place);
    if (!covariance) {
      return tl::unexpected(covariance.error());
    }
    out.covariance_mm2 = *covariance;
    return out;
  }

private:
  [[nodiscard]] std::string cell(const CsvRow &row, Meaning meaning) const {
    return layout_.has(meaning) && layout_.at(meaning) < row.cells.size() ? row.cells[layout_.at(meaning)] : "";
  }

  [[nodiscard]] base::Result<double> number(const CsvRow &row, Meaning meaning, const std::string &place) const {
    const std::string text = cell(row, meaning);
    const auto value = table_.number(text);
    if (!value || !std::isfinite(*value)) {
      const bool comma = text.find(',') != std::string::npos;
      return base::failure(place + layout_.columns()[layout_.at(meaning)].word + " = \"" + text +
                           "\": must be a finite number" +
                           (comma ? ", and it is not clear whether the comma begins its decimals" : ""));
    }
    return *value;
  }

  [[nodiscard]] base::Result<std::optional<Eigen::Matrix3d>> covariance_of(const CsvRow &row,
                                                                           const std::string &place) const {
    using enum Meaning;
    const auto all = [this](std::initializer_list<Meaning> meanings) {
      return std::all_of(meanings.begin(), meanings.end(), [this](Meaning one) { return layout_.has(one); });
    };
    const bool each = all({kSigmaX, kSigmaY, kSigmaZ});
    const bool whole = all({kCxx, kCxy, kCxz, kCyy, kCyz, kCzz});
    if (!layout_.has(kSigma) && !each && !whole) {
      return std::nullopt;
    }
    std::array<double, 6> values{};
    const auto meanings = whole  ? std::vector{kCxx, kCxy, kCxz, kCyy, kCyz, kCzz}
                          : each ? std::vector{kSigmaX, kSigmaY, kSigmaZ}
                                 : std::vector{kSigma, kSigma, kSigma};
    for (std::size_t i = 0; i < meanings.size(); ++i) {
      const auto value = number(row, meanings[i], place);
      if (!value) {
        return tl::unexpected(value.error());
      }
      values[i] = *value;
    }
    Eigen::Matrix3d out;
    if (whole) {
      out << values[0], values[1], values[2], values[1], values[3], values[4], values[2], values[4], values[5];
    } else {
      out = Eigen::Vector3d(values.data()).cwiseAbs2().asDiagonal();
    }
    const bool positive = whole ? out.llt().info() == Eigen::Success : Eigen::Vector3d(values.data()).minCoeff() > 0.0;
    if (!positive) {
      return base::failure(place + "its error must be positive in every direction");
    }
    return Eigen::Matrix3d(scale_ * scale_ * signs_.asDiagonal() * out * signs_.asDiagonal());
  }

  const CsvTable &table_;
  const Layout &layout_;
  double scale_;
  Eigen::Vector3d signs_;
};

} // namespace

bool is_point_table(const std::filesystem::path &file) {
  const std::string extension = base::lower(file.extension().string());
  return extension == ".csv" || extension == ".tsv" || extension == ".txt";
}

base::Result<PointTable> read_point_table(const std::filesystem::path &file, const PointTableOptions &options) {
  auto table = base::read_csv(file);
  if (!table) {
    return tl::unexpected(table.error());
  }
  PointTable out;
  const detail::PointHeader header = detail::point_header(*table);
  const std::span<const CsvRow> rows = std::span<const CsvRow>(table->rows).subspan(header.is_first_row ? 1 : 0);
  const auto stated = detail::statements_of(*table);
  if (!stated) {
    return tl::unexpected(stated.error());
  }
  const PointTableOptions used{stated->space ? stated->space : options.space, stated->unit.value_or(options.unit),
                               options.curves};
  const auto layout = detail::layout_of(*table, header, used);
  if (!layout) {
    return tl::unexpected(layout.error());
  }
  if (rows.empty()) {
    return out;
  }
  if (stated->space) {
    if (auto agrees = layout->check_space(*stated->space); !agrees) {
      return tl::unexpected(agrees.error());
    }
  }
  if (stated->unit && layout->unit() && stated->unit != layout->unit()) {
    return base::failure(table->file + ": its columns contradict the unit that a comment states");
  }
  out.named = layout->has(Meaning::kName) || layout->has(Meaning::kId);
  out.notes = detail::notes_of(*table, *layout, header, used);
  if ((stated->space && options.space && stated->space != options.space) ||
      (stated->unit && options.unit != LengthUnit::kMillimetre && stated->unit != options.unit)) {
    out.notes.push_back(table->file + ": its comments state a space or a unit, which have priority over options");
  }
  const Reader reader(*table, *layout, used);
  for (const CsvRow &row : rows) {
    auto point = reader.read(row, out.points.size() + 1);
    if (!point) {
      return tl::unexpected(point.error());
    }
    if (*point) {
      out.points.push_back(std::move(**point));
    } else {
      out.notes.push_back(table->place(row) + "\"" + reader.name(row, out.points.size() + 1) +
                          "\" was never placed: it is left out");
    }
  }
  return out;
}

} // namespace bregma::casefile
