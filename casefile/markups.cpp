#include "casefile/markups.hpp"

#include <cmath>
#include <fstream>
#include <sstream>

#include <nlohmann/json.hpp>

#include "base/read_file.hpp"
#include "base/text.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::size_t kMaxMarkupBytes = std::size_t{16} << 20; // a parsed file takes many times its size
constexpr const char *kSchema = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
                                "Resources/Schema/markups-schema-v1.0.3.json#";

// Names since Slicer 4.11; numbers of MRML before that: RAS = 0, LPS = 1.
std::optional<Space> space_of(const std::string &text) {
  return text == "1" ? Space::kLps : text == "0" ? Space::kRas : space_named(text);
}

std::optional<Markup::Kind> kind_of(const std::string &type) {
  using Kind = Markup::Kind;
  for (const auto &[name, kind] : {std::pair("Fiducial", Kind::kPoints),
                                   {"Line", Kind::kLine},
                                   {"Curve", Kind::kCurve},
                                   {"ClosedCurve", Kind::kClosedCurve}}) {
    if (type == name) {
      return kind;
    }
  }
  return std::nullopt;
}

std::string shown(const Json &value) { return value.is_string() ? value.get<std::string>() : value.dump(); }

// Reader of one file. Every message starts with the file's name.
class JsonMarkups {
public:
  explicit JsonMarkups(const fs::path &file) : file_(file.string()) {}

  base::Result<std::vector<Markup>> read(const Json &document) const {
    const auto markups = document.find("markups");
    if (!document.is_object() || markups == document.end() || !markups->is_array()) {
      return base::failure(file_ + ": is not a Slicer markups file: it has no list \"markups\"");
    }
    std::vector<Markup> out;
    for (const Json &item : *markups) {
      auto markup = read_markup(item, "markup " + std::to_string(out.size() + 1));
      if (!markup) {
        return tl::unexpected(markup.error());
      }
      out.push_back(std::move(*markup));
    }
    return out;
  }

private:
  base::Result<Markup> read_markup(const Json &item, const std::string &which) const {
    if (!item.is_object()) {
      return base::failure(file_ + ": " + which + ": is not a markup");
    }
    Markup markup;
    const std::string type = item.contains("type") ? shown(item["type"]) : "";
    const auto kind = kind_of(type);
    if (!kind) {
      return base::failure(file_ + ": " + which + ": type = \"" + type +
                           "\": only Fiducial, Line, Curve and ClosedCurve are read");
    }
    markup.kind = *kind;
    if (item.contains("name") && item["name"].is_string()) {
      markup.name = item["name"].get<std::string>();
    }
    const std::string space_text = item.contains("coordinateSystem") ? shown(item["coordinateSystem"]) : "LPS";
    const auto space = space_of(space_text);
    if (!space) {
      return base::failure(file_ + ": " + which + ": coordinateSystem = \"" + space_text + "\": must be LPS or RAS");
    }
    if (item.contains("coordinateUnits") && shown(item["coordinateUnits"]) != "mm") {
      return base::failure(file_ + ": " + which + ": coordinateUnits = \"" + shown(item["coordinateUnits"]) +
                           "\": must be mm");
    }
    const auto points = item.find("controlPoints");
    if (points == item.end() || !points->is_array()) {
      return base::failure(file_ + ": " + which + ": has no list \"controlPoints\"");
    }
    for (const Json &point : *points) {
      const std::string place = file_ + ": " + which + ", control point " + std::to_string(markup.points.size() + 1);
      auto read = read_point(point, place, *space);
      if (!read) {
        return tl::unexpected(read.error());
      }
      markup.points.push_back(std::move(*read));
    }
    if (markup.kind == Markup::Kind::kLine && markup.points.size() != 2) {
      return base::failure(file_ + ": " + which + ": a line has two control points, this one has " +
                           std::to_string(markup.points.size()));
    }
    return markup;
  }

  static base::Result<NamedPoint> read_point(const Json &point, std::string place, Space space) {
    NamedPoint out;
    if (point.is_object() && point.contains("label") && point["label"].is_string()) {
      out.name = point["label"].get<std::string>();
    }
    place += out.name.find_first_not_of(' ') == std::string::npos ? "" : " (" + out.name + ")";
    if (!point.is_object()) {
      return base::failure(place + ": is not a control point");
    }
    if (point.contains("positionStatus") && shown(point["positionStatus"]) != "defined") {
      return base::failure(place + ": positionStatus = \"" + shown(point["positionStatus"]) +
                           "\": it was never placed");
    }
    const auto position = point.find("position");
    if (position == point.end()) {
      return base::failure(place + ": has no position");
    }
    const bool three = position->is_array() && position->size() == 3;
    for (std::size_t i = 0; i < 3; ++i) {
      if (!three || !(*position)[i].is_number()) {
        return base::failure(place + ": position = " + position->dump() + ": must be three numbers");
      }
      out.position_mm[static_cast<Eigen::Index>(i)] = (*position)[i].get<double>();
    }
    if (!out.position_mm.allFinite()) {
      return base::failure(place + ": position = " + position->dump() + ": must be finite");
    }
    if (space == Space::kLps) {
      out.position_mm = flipped(out.position_mm);
    }
    return out;
  }

  std::string file_;
};

// Slicer's older format: comment lines with the coordinate system and the columns, then one point per line.
base::Result<std::vector<Markup>> read_fcsv(const fs::path &file, std::istream &in) {
  Markup markup;
  markup.name = file.stem().string();
  Space space = Space::kRas; // the default of Slicer 4 without that line
  std::vector<std::string> columns{"id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label"};
  std::string line;
  for (int line_number = 1; std::getline(in, line); ++line_number) {
    const std::string place = file.string() + ":" + std::to_string(line_number);
    const std::string_view text = base::trimmed(line);
    if (text.starts_with("#")) {
      const auto equals = text.find('=');
      const std::string value(equals == std::string_view::npos ? "" : base::trimmed(text.substr(equals + 1)));
      if (text.find("CoordinateSystem") != std::string::npos) {
        const auto given = space_of(value);
        if (!given) {
          return base::failure(place + ": CoordinateSystem = " + value + ": must be LPS or RAS (1 or 0)");
        }
        space = *given;
      } else if (text.find("columns") != std::string::npos) {
        const auto names = base::cells(value, ',');
        columns.assign(names.begin(), names.end());
      }
      continue;
    }
    if (text.empty()) {
      continue;
    }
    const std::vector<std::string_view> row = base::cells(text, ',');
    NamedPoint point;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const std::string &name = columns[i];
      const std::string cell(i < row.size() ? row[i] : "");
      if (name == "label") {
        point.name = cell;
      }
      if (name != "x" && name != "y" && name != "z") {
        continue;
      }
      const auto value = base::parsed_number<double>(cell);
      if (!value || !std::isfinite(*value)) {
        return base::failure(place + ": control point " + std::to_string(markup.points.size() + 1) + ": " + name +
                             " = " + cell + ": must be a finite number");
      }
      point.position_mm[name[0] - 'x'] = *value;
    }
    point.position_mm = space == Space::kLps ? flipped(point.position_mm) : point.position_mm;
    markup.points.push_back(point);
  }
  return std::vector<Markup>{markup};
}

Json control_point(std::size_t index, const std::string &label, const Eigen::Vector3d &ras) {
  const Eigen::Vector3d lps = flipped(ras);
  return {{"id", std::to_string(index + 1)},
          {"label", label},
          {"description", ""},
          {"associatedNodeID", ""},
          {"position", {lps.x(), lps.y(), lps.z()}},
          {"selected", true},
          {"locked", false},
          {"visibility", true},
          {"positionStatus", "defined"}};
}

Json markup_json(const char *type, const std::string &name, Json points) {
  return {{"type", type},
          {"name", name},
          {"coordinateSystem", "LPS"},
          {"coordinateUnits", "mm"},
          {"locked", false},
          {"fixedNumberOfControlPoints", false},
          {"labelFormat", "%N-%d"},
          {"lastUsedControlPointNumber", points.size()},
          {"controlPoints", std::move(points)}};
}

base::Result<void> write(const fs::path &file, Json markups) {
  const Json document = {{"@schema", kSchema}, {"markups", std::move(markups)}};
  std::ofstream out(file, std::ios::binary);
  // Names come from other programs and may not be valid UTF-8.
  out << document.dump(2, ' ', false, Json::error_handler_t::replace) << "\n";
  out.flush();
  if (!out) {
    return base::failure(file.string() + ": cannot be written");
  }
  return {};
}

} // namespace

base::Result<std::vector<Markup>> read_markups(const fs::path &file) {
  const auto content = base::read_file(file, kMaxMarkupBytes);
  if (!content) {
    return tl::unexpected(content.error());
  }
  if (file.extension() == ".fcsv") {
    std::istringstream in(*content);
    return read_fcsv(file, in);
  }
  try {
    return JsonMarkups(file).read(Json::parse(*content));
  } catch (const Json::exception &problem) {
    return base::failure(file.string() + ": is not JSON: " + problem.what());
  }
}

base::Result<std::vector<NamedPoint>> read_points(const fs::path &file) {
  const auto markups = read_markups(file);
  if (!markups) {
    return tl::unexpected(markups.error());
  }
  std::vector<NamedPoint> out;
  for (const Markup &markup : *markups) {
    if (markup.kind != Markup::Kind::kPoints) {
      return base::failure(file.string() + ": \"" + markup.name + "\" is a " +
                           (markup.kind == Markup::Kind::kLine ? "line" : "curve") + " where points are expected");
    }
    out.insert(out.end(), markup.points.begin(), markup.points.end());
  }
  return out;
}

base::Result<std::vector<Trajectory>> read_trajectories(const fs::path &file) {
  const auto markups = read_markups(file);
  if (!markups) {
    return tl::unexpected(markups.error());
  }
  std::vector<Trajectory> out;
  for (const Markup &markup : *markups) {
    if (markup.kind != Markup::Kind::kLine) {
      return base::failure(file.string() + ": \"" + markup.name + "\" is a " +
                           (markup.kind == Markup::Kind::kPoints ? "list of points" : "curve") +
                           " where lines are expected");
    }
    const std::string name = markup.name.empty() ? file.stem().stem().string() : markup.name;
    out.push_back({name, markup.points[0].position_mm, markup.points[1].position_mm});
  }
  return out;
}

base::Result<void> write_points(const fs::path &file, const std::string &list_name,
                                std::span<const NamedPoint> points) {
  Json control_points = Json::array();
  for (const NamedPoint &point : points) {
    control_points.push_back(control_point(control_points.size(), point.name, point.position_mm));
  }
  return write(file, Json::array({markup_json("Fiducial", list_name, std::move(control_points))}));
}

base::Result<void> write_trajectories(const fs::path &file, std::span<const Trajectory> trajectories) {
  Json markups = Json::array();
  for (const Trajectory &t : trajectories) {
    markups.push_back(markup_json("Line", t.name,
                                  Json::array({control_point(0, t.name + "-entry", t.entry_mm),
                                               control_point(1, t.name + "-target", t.target_mm)})));
  }
  return write(file, std::move(markups));
}

} // namespace bregma::casefile
