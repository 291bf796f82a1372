#include "casefile/markups.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <set>

#include <nlohmann/json.hpp>

#include "base/csv_table.hpp"
#include "base/read_file.hpp"
#include "base/text.hpp"
#include "base/write_file.hpp"
#include "casefile/fcsv.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/markup_notes.hpp"
#include "casefile/point_table.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::size_t kMaxMarkupBytes = std::size_t{16} << 20; // a parsed file takes many times its size
constexpr const char *kSchema = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
                                "Resources/Schema/markups-schema-v1.0.3.json#";

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

// A file may contain anything, also text that is not UTF-8.
std::string shown(const Json &value) {
  return value.is_string() ? value.get<std::string>() : value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

// "mm", or an entry of the code UCUM: ["mm", "UCUM", "millimeter"], {"codeValue": "mm", ...}.
std::string unit_text(const Json &value) {
  if (value.is_array() && !value.empty()) {
    return shown(value.front());
  }
  return value.is_object() && value.contains("codeValue") ? shown(value["codeValue"]) : shown(value);
}

// null is no label.
std::string label_of(const Json &point) {
  const bool has_label = point.is_object() && point.contains("label") && !point["label"].is_null();
  return has_label ? shown(point["label"]) : std::string();
}

const char *noun_of(Markup::Kind kind) {
  return kind == Markup::Kind::kPoints ? "list of points" : kind == Markup::Kind::kLine ? "line" : "curve";
}

// The document, and the first key that an object has twice, of which a parser would take the last.
struct Parsed {
  Json document;
  std::string repeated;
};
Parsed parsed_once(const std::string &text) {
  Parsed out;
  std::vector<std::set<std::string>> keys; // of the objects around a place
  out.document = Json::parse(text, [&](int, Json::parse_event_t event, Json &value) {
    if (event == Json::parse_event_t::object_start) {
      keys.emplace_back();
    } else if (event == Json::parse_event_t::object_end) {
      keys.pop_back();
    } else if (event == Json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second &&
               out.repeated.empty()) {
      out.repeated = value.get<std::string>();
    }
    return true;
  });
  return out;
}

// In Slicer's column "Description" of a control point: the registered image in which it was placed.
constexpr std::string_view kImageNote = "image: ";

std::string image_of(const Json &point) {
  const auto description = point.find("description");
  const std::string text =
      description != point.end() && description->is_string() ? description->get<std::string>() : std::string();
  return text.starts_with(kImageNote) ? std::string(base::trimmed(std::string_view(text).substr(kImageNote.size())))
                                      : std::string();
}

// Reader of one file. Every message starts with the file's name.
class JsonMarkups {
public:
  JsonMarkups(const fs::path &file, Notes *notes, const MarkupDefaults &defaults)
      : file_(file.string()), notes_(notes), defaults_(defaults) {}

  base::Result<std::vector<Markup>> read(const Json &document) const {
    const auto markups = document.find("markups");
    if (!document.is_object() || markups == document.end() || !markups->is_array()) {
      return base::failure(file_ + ": is not a Slicer markups file: it has no list \"markups\"");
    }
    std::vector<Markup> out;
    std::vector<std::string> others;
    std::size_t number = 0;
    for (const Json &item : *markups) {
      const std::string which = "markup " + std::to_string(++number);
      const std::string type = item.is_object() && item.contains("type") ? shown(item["type"]) : "";
      const auto kind = kind_of(type);
      if (item.is_object() && !kind) {
        others.push_back(file_ + ": " + which + ": type = \"" + type + "\"");
        continue;
      }
      auto markup = read_markup(item, which);
      if (!markup) {
        return tl::unexpected(markup.error());
      }
      markup->kind = *kind;
      if (markup->kind == Markup::Kind::kLine && markup->points.size() != 2) {
        return base::failure(file_ + ": " + which + ": a line has two control points, this one has " +
                             std::to_string(markup->points.size()));
      }
      out.push_back(std::move(*markup));
    }
    for (const std::string &other : others) {
      constexpr const char *kOnly = ": only Fiducial, Line, Curve and ClosedCurve are read";
      if (out.empty()) {
        return base::failure(other + kOnly);
      }
      if (auto left = leave_out(other, kOnly, notes_); !left) {
        return tl::unexpected(left.error());
      }
    }
    return out;
  }

private:
  base::Result<Markup> read_markup(const Json &item, const std::string &which) const {
    if (!item.is_object()) {
      return base::failure(file_ + ": " + which + ": is not a markup");
    }
    Markup markup;
    if (item.contains("name") && item["name"].is_string()) {
      markup.name = item["name"].get<std::string>();
    }
    const std::string default_space(name_of(defaults_.space.value_or(Space::kLps)));
    const std::string space_text = item.contains("coordinateSystem") ? shown(item["coordinateSystem"]) : default_space;
    const auto space = space_of(space_text);
    if (!space) {
      return base::failure(file_ + ": " + which + ": coordinateSystem = \"" + space_text + "\": must be LPS or RAS");
    }
    if (!item.contains("coordinateSystem")) {
      if (auto taken = assume(file_ + ": " + which + ": its coordinateSystem is not stated", default_space, notes_);
          !taken) {
        return tl::unexpected(taken.error());
      }
    }
    const std::string default_unit(name_of(defaults_.unit.value_or(LengthUnit::kMillimetre)));
    // Slicer 4 and 5.0 do not write it, and mm is the default of the format: also a reader without notes takes it.
    if (!item.contains("coordinateUnits") && notes_ != nullptr) {
      notes_->push_back(file_ + ": " + which + ": its coordinateUnits are not stated: " + default_unit + " is assumed");
    }
    const std::string unit_name = item.contains("coordinateUnits") ? unit_text(item["coordinateUnits"]) : default_unit;
    const auto unit = unit_named(unit_name);
    if (!unit) {
      return base::failure(file_ + ": " + which + ": coordinateUnits = \"" + unit_name + "\": must be mm, cm, m or um");
    }
    const auto points = item.find("controlPoints");
    if (points == item.end() || !points->is_array()) {
      return base::failure(file_ + ": " + which + ": has no list \"controlPoints\"");
    }
    std::size_t number = 0;
    for (const Json &point : *points) {
      std::string place = file_ + ": " + which + ", control point " + std::to_string(++number);
      const std::string label = label_of(point);
      place += label.find_first_not_of(' ') == std::string::npos ? "" : " (" + label + ")";
      if (point.is_object() && point.contains("positionStatus") && shown(point["positionStatus"]) != "defined") {
        const std::string never =
            place + ": positionStatus = \"" + shown(point["positionStatus"]) + "\": it was never placed";
        if (auto left = leave_out(never, kPlaceIt, notes_); !left) {
          return tl::unexpected(left.error());
        }
        continue;
      }
      auto read = read_point(point, label, place);
      if (!read) {
        return tl::unexpected(read.error());
      }
      read->position_mm *= mm_per(*unit);
      read->position_mm = *space == Space::kLps ? flipped(read->position_mm) : read->position_mm;
      markup.points.push_back(std::move(*read));
    }
    return markup;
  }

  // In the coordinates of the file.
  static base::Result<NamedPoint> read_point(const Json &point, const std::string &label, const std::string &place) {
    if (!point.is_object()) {
      return base::failure(place + ": is not a control point");
    }
    NamedPoint out;
    out.name = label;
    out.placed_in = image_of(point);
    const auto position = point.find("position");
    if (position == point.end()) {
      return base::failure(place + ": has no position");
    }
    const bool three = position->is_array() && position->size() == 3;
    for (std::size_t i = 0; i < 3; ++i) {
      if (!three || !(*position)[i].is_number()) {
        return base::failure(place + ": position = " + shown(*position) + ": must be three numbers");
      }
      out.position_mm[static_cast<Eigen::Index>(i)] = (*position)[i].get<double>();
    }
    if (!out.position_mm.allFinite()) {
      return base::failure(place + ": position = " + shown(*position) + ": must be finite");
    }
    return out;
  }

  std::string file_;
  Notes *notes_;
  MarkupDefaults defaults_;
};

Json control_point(std::size_t index, const std::string &label, const Eigen::Vector3d &ras,
                   const std::string &placed_in) {
  const Eigen::Vector3d lps = flipped(ras);
  return {{"id", std::to_string(index + 1)},
          {"label", label},
          {"description", placed_in.empty() ? "" : std::string(kImageNote) + placed_in},
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
  // Names come from other programs and may not be valid UTF-8.
  return base::write_file(file, document.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

// Markups of one kind. Others beside them are left out; a file of others alone is refused.
base::Result<std::vector<Markup>> read_only(const fs::path &file, Notes *notes, const MarkupDefaults &defaults,
                                            const char *expected, const std::function<bool(Markup::Kind)> &wanted) {
  auto markups = read_markups(file, notes, defaults);
  if (!markups) {
    return markups;
  }
  std::vector<Markup> out;
  std::vector<std::string> others;
  for (Markup &markup : *markups) {
    if (wanted(markup.kind)) {
      out.push_back(std::move(markup));
    } else {
      others.push_back(file.string() + ": \"" + markup.name + "\" is a " + noun_of(markup.kind) + " where " + expected +
                       " are expected");
    }
  }
  for (const std::string &other : others) {
    if (auto left = out.empty() ? base::failure(other) : leave_out(other, "", notes); !left) {
      return tl::unexpected(left.error());
    }
  }
  return out;
}

} // namespace

base::Result<std::vector<Markup>> read_markups(const fs::path &file, Notes *notes, const MarkupDefaults &defaults) {
  if (base::lower(file.extension().string()) == ".fcsv") {
    return read_fcsv(file, notes, defaults);
  }
  if (is_point_table(file)) {
    return base::failure(file.string() + ": is a table; Slicer's lists are read here, .mrk.json or .fcsv");
  }
  auto content = base::read_file(file, kMaxMarkupBytes).and_then([&](std::string bytes) {
    return base::utf8_of(file, std::move(bytes));
  });
  if (!content) {
    return tl::unexpected(content.error());
  }
  try {
    const Parsed parsed = parsed_once(*content);
    if (!parsed.repeated.empty()) {
      return base::failure(file.string() + ": the key \"" + parsed.repeated + "\" is stated twice in one place");
    }
    return JsonMarkups(file, notes, defaults).read(parsed.document);
  } catch (const Json::parse_error &problem) {
    // The number of characters read, with that at which the error was noticed.
    const std::size_t at = std::min(std::max<std::size_t>(problem.byte, 1) - 1, content->size());
    const auto line = 1 + std::count(content->begin(), content->begin() + static_cast<std::ptrdiff_t>(at), '\n');
    const std::string_view left = base::trimmed(std::string_view(*content).substr(at));
    const std::string place = file.string() + ":" + std::to_string(line) + ": ";
    return base::failure(left.empty()
                             ? place + "is not whole: its JSON ends within a value"
                             : place + "is not JSON: \"" + std::string(left.substr(0, 20)) + "\" is not expected here");
  } catch (const Json::exception &) { // a number beyond every double
    return base::failure(file.string() + ": is not JSON: a value cannot be read");
  }
}

base::Result<std::vector<NamedPoint>> read_points(const fs::path &file, Notes *notes, const MarkupDefaults &defaults) {
  const auto lists =
      read_only(file, notes, defaults, "points", [](Markup::Kind kind) { return kind == Markup::Kind::kPoints; });
  if (!lists) {
    return tl::unexpected(lists.error());
  }
  std::vector<NamedPoint> out;
  for (const Markup &list : *lists) {
    out.insert(out.end(), list.points.begin(), list.points.end());
  }
  return out;
}

base::Result<std::vector<Trajectory>> read_trajectories(const fs::path &file, Notes *notes) {
  const auto lines = read_only(file, notes, {}, "lines", [](Markup::Kind kind) { return kind == Markup::Kind::kLine; });
  if (!lines) {
    return tl::unexpected(lines.error());
  }
  std::vector<Trajectory> out;
  for (const Markup &line : *lines) {
    const std::string name = line.name.empty() ? file.stem().stem().string() : line.name;
    out.push_back({name, line.points[0].position_mm, line.points[1].position_mm, line.points[0].placed_in,
                   line.points[1].placed_in});
  }
  return out;
}

base::Result<void> write_points(const fs::path &file, const std::string &list_name,
                                std::span<const NamedPoint> points) {
  Json control_points = Json::array();
  for (const NamedPoint &point : points) {
    control_points.push_back(control_point(control_points.size(), point.name, point.position_mm, point.placed_in));
  }
  return write(file, Json::array({markup_json("Fiducial", list_name, std::move(control_points))}));
}

base::Result<void> write_trajectories(const fs::path &file, std::span<const Trajectory> trajectories) {
  Json markups = Json::array();
  for (const Trajectory &t : trajectories) {
    markups.push_back(markup_json("Line", t.name,
                                  Json::array({control_point(0, t.name + "-entry", t.entry_mm, t.entry_in),
                                               control_point(1, t.name + "-target", t.target_mm, t.target_in)})));
  }
  return write(file, std::move(markups));
}

} // namespace bregma::casefile
