#include "casefile/fcsv.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <Eigen/Core>

#include "base/csv_table.hpp"
#include "base/text.hpp"
#include "casefile/markup_notes.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

namespace {

// Slicer 5 writes two cells more than it names: the status of the position, and whether it was made automatically.
class Fcsv {
public:
  static base::Result<std::vector<Markup>> read(const std::filesystem::path &file, Notes *notes,
                                                const MarkupDefaults &defaults) {
    const auto table = base::read_csv(file);
    if (!table) {
      return tl::unexpected(table.error());
    }
    Fcsv reader(*table);
    if (auto header = reader.read_comments(); !header) {
      return tl::unexpected(header.error());
    }
    if (!reader.space_) {
      reader.space_ = defaults.space.value_or(Space::kRas);
      if (auto taken = assume(file.string() + ": its CoordinateSystem is not stated",
                              std::string(name_of(*reader.space_)), notes);
          !taken) {
        return tl::unexpected(taken.error());
      }
    }
    Markup markup;
    markup.name = file.stem().string();
    std::size_t number = 0;
    for (const base::CsvRow &row : table->rows) {
      const std::string name = reader.cell(row, "label");
      const std::string place =
          table->place(row) + "control point " + std::to_string(++number) + (name.empty() ? "" : " (" + name + ")");
      if (auto whole = reader.check_whole(row, place); !whole) {
        return tl::unexpected(whole.error());
      }
      const std::string status = reader.status(row);
      if (!status.empty() && status != kDefined) {
        if (auto left = leave_out(place + ": positionStatus = " + status + ": it was never placed", kPlaceIt, notes);
            !left) {
          return tl::unexpected(left.error());
        }
        continue;
      }
      auto position = reader.position(row, place);
      if (!position) {
        return tl::unexpected(position.error());
      }
      markup.points.push_back({name, *position});
    }
    return std::vector<Markup>{std::move(markup)};
  }

private:
  static constexpr const char *kDefined = "2"; // vtkMRMLMarkupsNode::PositionDefined

  explicit Fcsv(const base::CsvTable &table) : table_(table) {}

  base::Result<void> read_comments() {
    bool columns_stated = false;
    for (const base::CsvComment &comment : table_.comments) {
      const std::size_t equals = comment.text.find('=');
      const std::string value(equals == std::string::npos ? "" : base::trimmed(comment.text.substr(equals + 1)));
      if (comment.text.find("CoordinateSystem") != std::string::npos) {
        const auto given = space_of(value);
        if (!given) {
          return base::failure(table_.file + ":" + std::to_string(comment.line) + ": CoordinateSystem = " + value +
                               ": must be LPS or RAS (1 or 0)");
        }
        if (space_ && space_ != given) {
          return base::failure(table_.file + ":" + std::to_string(comment.line) + ": CoordinateSystem = " + value +
                               ": is stated before as another one");
        }
        space_ = *given;
      } else if (comment.text.find("columns") != std::string::npos) {
        const auto columns = base::csv_cells(value).value_or(columns_);
        if (columns_stated && columns != columns_) {
          return base::failure(table_.file + ":" + std::to_string(comment.line) +
                               ": the columns are stated before in another way");
        }
        columns_ = columns;
        columns_stated = true;
      }
    }
    return {};
  }

  // A row that was cut, which may have lost its name. Empty cells at the end of a row are not kept.
  [[nodiscard]] base::Result<void> check_whole(const base::CsvRow &row, const std::string &place) const {
    const auto label =
        static_cast<std::size_t>(std::find(columns_.begin(), columns_.end(), "label") - columns_.begin());
    return row.cells.size() >= std::min(label, columns_.size())
               ? base::Result<void>()
               : base::failure(place + ": the row has " + std::to_string(row.cells.size()) + " cells, " +
                               std::to_string(columns_.size()) + " columns are stated: it is not whole");
  }

  [[nodiscard]] std::string cell(const base::CsvRow &row, std::string_view column) const {
    const auto at = static_cast<std::size_t>(std::find(columns_.begin(), columns_.end(), column) - columns_.begin());
    return at < std::min(columns_.size(), row.cells.size()) ? row.cells[at] : "";
  }

  [[nodiscard]] std::string status(const base::CsvRow &row) const {
    return row.cells.size() > columns_.size() ? row.cells[columns_.size()] : "";
  }

  [[nodiscard]] base::Result<Eigen::Vector3d> position(const base::CsvRow &row, const std::string &place) const {
    Eigen::Vector3d out;
    for (const char axis : {'x', 'y', 'z'}) {
      const std::string text = cell(row, {&axis, 1});
      const auto value = table_.number(text);
      if (!value || !std::isfinite(*value)) {
        return base::failure(place + ": " + axis + " = " + text + ": must be a finite number");
      }
      out[axis - 'x'] = *value;
    }
    return space_ == Space::kLps ? flipped(out) : out;
  }

  const base::CsvTable &table_;
  std::optional<Space> space_;
  // Slicer's, where the file does not name them.
  std::vector<std::string> columns_{"id", "x",   "y",   "z",    "ow",    "ox",   "oy",
                                    "oz", "vis", "sel", "lock", "label", "desc", "associatedNodeID"};
};

} // namespace

base::Result<std::vector<Markup>> read_fcsv(const std::filesystem::path &file, Notes *notes,
                                            const MarkupDefaults &defaults) {
  return Fcsv::read(file, notes, defaults);
}

} // namespace bregma::casefile
