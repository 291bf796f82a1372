// PLUS sequence files: a header of MetaImage or NRRD with fields Seq_Frame0012_StylusToTrackerTransform = ..., and
// images after it or in another file.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <deque>
#include <fstream>
#include <optional>
#include <set>
#include <system_error>

#include "base/text.hpp"
#include "casefile/pose_text.hpp"
#include "casefile/poses.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFramePrefix = "Seq_Frame";
constexpr std::string_view kTransform = "Transform";
constexpr std::string_view kStatus = "TransformStatus";

struct Ends {
  std::string source, target;
};

// "StylusToReference". PLUS requires that no frame's name contains "To".
std::optional<Ends> ends_of(std::string_view name) {
  for (std::size_t at = name.find("To", 1); at != std::string_view::npos; at = name.find("To", at + 1)) {
    const std::string_view rest = name.substr(at + 2);
    if (!rest.empty() && std::isupper(static_cast<unsigned char>(rest.front())) != 0) {
      return Ends{std::string(name.substr(0, at)), std::string(rest)};
    }
  }
  return std::nullopt;
}

class SequenceReader {
public:
  explicit SequenceReader(const fs::path &file) { out_.file = file; }

  base::Result<TransformSequence> read(std::istream &in) {
    std::string line;
    bool nrrd = false;
    bool ended = false;
    for (line_ = 1; !ended && std::getline(in, line); ++line_) {
      const std::string_view text = base::trimmed(line);
      nrrd = nrrd || (line_ == 1 && text.starts_with("NRRD"));
      if (nrrd && (line_ == 1 || text.empty() || text.front() == '#')) {
        ended = text.empty(); // the pixels follow
        continue;
      }
      // MetaImage: "field = value". NRRD: "field: value", and "field:=value" for those of other programs.
      const std::size_t separator = nrrd ? text.find(':') : text.find('=');
      if (separator == std::string_view::npos) {
        return base::failure(place() + "is not \"field = value\": is this a PLUS sequence file?");
      }
      const std::string_view field = base::trimmed(text.substr(0, separator));
      const bool both = nrrd && text.substr(separator).starts_with(":=");
      const std::string_view value = base::trimmed(text.substr(separator + (both ? 2 : 1)));
      ended = !nrrd && field == "ElementDataFile"; // the pixels follow
      if (!field.starts_with(kFramePrefix)) {
        keep_of_images(field, value);
        continue;
      }
      if (auto taken = take(field.substr(kFramePrefix.size()), value); !taken) {
        return tl::unexpected(taken.error());
      }
    }
    if (!ended && !frames_.empty()) {
      return base::failure(out_.file.string() + ": is not whole: its header does not end");
    }
    const auto position = in.tellg();
    return check_frames().and_then([&] { return check_images(static_cast<std::uint64_t>(position)); }).and_then([&] {
      return finished();
    });
  }

private:
  // Of the header of the images: their number, and what is needed for the number of their bytes.
  void keep_of_images(std::string_view field, std::string_view value) {
    if (field == "DimSize" || field == "sizes") {
      sizes_ = detail::parse_numbers(value).value_or(std::vector<double>{});
    } else if (field == "ElementType" || field == "type") {
      bytes_only_ = value == "MET_UCHAR" || value == "MET_CHAR" || value == "uchar" || value == "unsigned char" ||
                    value == "uint8";
    } else if ((field == "CompressedData" && value != "False") || (field == "encoding" && value != "raw") ||
               (field == "ElementDataFile" && value != "LOCAL") || field == "data file" || field == "datafile") {
      raw_here_ = false;
    } else if (field == "CompressedDataSize") {
      compressed_bytes_ = base::parsed_number<std::uint64_t>(value);
    }
  }

  // The last size is the number of frames.
  [[nodiscard]] base::Result<void> check_frames() const {
    const auto refuse = [this](const std::string &what) {
      return base::failure(out_.file.string() + ": is not whole: " + what);
    };
    if (frames_.empty()) {
      return {};
    }
    if (sizes_.size() >= 3 && sizes_.back() != static_cast<double>(frames_.size())) {
      return refuse("its header has fields of " + std::to_string(frames_.size()) + " frames, and states " +
                    std::to_string(static_cast<std::int64_t>(sizes_.back())));
    }
    if (const std::size_t last = frames_.rbegin()->first; last - frames_.begin()->first + 1 != frames_.size()) {
      return refuse("fields of " + std::to_string(last - frames_.begin()->first + 1 - frames_.size()) +
                    " frames between the first and the last are missing");
    }
    return {};
  }

  // The images are not read, but their bytes show whether the file is whole.
  [[nodiscard]] base::Result<void> check_images(std::uint64_t begin) const {
    std::error_code error;
    const std::uintmax_t size = fs::file_size(out_.file, error);
    double needed = raw_here_ && bytes_only_ && !sizes_.empty() ? 1.0 : 0.0;
    for (const double length : sizes_) {
      needed *= length;
    }
    if (compressed_bytes_) {
      needed = static_cast<double>(*compressed_bytes_);
    }
    if (error || frames_.empty() || size < begin || static_cast<double>(size - begin) >= needed) {
      return {};
    }
    return base::failure(out_.file.string() + ": is not whole: it holds " + std::to_string(size - begin) +
                         " bytes of images, its header asks for " + std::to_string(static_cast<std::uint64_t>(needed)));
  }

  struct Raw {
    std::vector<double> numbers;
    std::string wrong; // why the numbers are unreadable; used only if the status is OK
    int line = 0;
    std::optional<bool> ok;
  };
  struct RawFrame {
    std::optional<std::int64_t> time_ns;
    std::map<std::string, Raw, std::less<>> transforms;
  };

  std::string place() const { return out_.file.string() + ":" + std::to_string(line_) + ": "; }

  // "0012_StylusToTrackerTransform"
  base::Result<void> take(std::string_view field, std::string_view value) {
    std::size_t number = 0;
    const auto parsed = std::from_chars(field.data(), field.data() + field.size(), number);
    const auto digits = static_cast<std::size_t>(parsed.ptr - field.data());
    if (parsed.ec != std::errc() || digits >= field.size() || field[digits] != '_') {
      return base::failure(place() + "Seq_Frame" + std::string(field) + ": has no frame number");
    }
    RawFrame &frame = frames_[number];
    const std::string_view name = field.substr(digits + 1);
    if (const auto [stated, fresh] = seen_.emplace(field, value); !fresh && stated->second != value) {
      return base::failure(place() + "Seq_Frame" + std::string(field) + ": is stated before with another value");
    }
    if (name == "Timestamp") {
      const auto seconds = detail::parse_numbers(value);
      if (!seconds || seconds->size() != 1 || std::abs(seconds->front()) > 9e9) {
        return base::failure(place() + "frame " + std::to_string(number) + ": Timestamp = " + std::string(value) +
                             ": must be a time in seconds");
      }
      frame.time_ns = std::llround(seconds->front() * 1e9);
    } else if (name.ends_with(kStatus)) {
      frame.transforms[std::string(name.substr(0, name.size() - kStatus.size()))].ok = value == "OK";
    } else if (name.ends_with(kTransform)) {
      Raw &raw = frame.transforms[std::string(name.substr(0, name.size() - kTransform.size()))];
      raw.line = line_;
      auto numbers = detail::parse_numbers(value);
      if (numbers) {
        raw.numbers = std::move(*numbers);
      } else {
        raw.wrong = numbers.error();
      }
    }
    return {};
  }

  base::Result<TransformSequence> finished() {
    if (frames_.empty()) {
      return base::failure(out_.file.string() +
                           ": holds no frames (fields Seq_Frame0000_...): is this a PLUS sequence file?");
    }
    for (const auto &[number, raw_frame] : frames_) {
      if (!raw_frame.time_ns) {
        return base::failure(out_.file.string() + ": frame " + std::to_string(number) + ": has no Timestamp");
      }
      SequenceFrame frame;
      frame.time_ns = *raw_frame.time_ns;
      for (const auto &[name, raw] : raw_frame.transforms) {
        auto entry = finished(raw, name, number);
        if (!entry) {
          return tl::unexpected(entry.error());
        }
        frame.transforms.emplace(name, *entry);
      }
      out_.frames.push_back(std::move(frame));
    }
    return std::move(out_);
  }

  base::Result<SequenceFrame::Entry> finished(const Raw &raw, const std::string &name, std::size_t number) {
    SequenceFrame::Entry entry;
    // Transforms that the tracker marks as invalid may have any content. A missing status counts as invalid.
    if (!raw.ok.value_or(false)) {
      return entry;
    }
    line_ = raw.line;
    const std::string which = place() + "frame " + std::to_string(number) + ": " + name + "Transform: ";
    if (!raw.wrong.empty()) {
      return base::failure(which + raw.wrong);
    }
    const auto pose = detail::rigid_from_rows(raw.numbers);
    if (!pose) {
      return base::failure(which + pose.error());
    }
    return SequenceFrame::Entry{*pose, true};
  }

  TransformSequence out_;
  std::map<std::size_t, RawFrame> frames_;
  std::map<std::string, std::string, std::less<>> seen_; // fields of frames
  std::vector<double> sizes_;                            // of the images
  bool bytes_only_ = false, raw_here_ = true;
  std::optional<std::uint64_t> compressed_bytes_;
  int line_ = 0;
};

struct Link {
  std::string name;
  bool inverse = false;
};

// The shortest chain of recorded transforms from source to target, first applied first.
std::optional<std::vector<Link>> find_chain(const std::vector<std::string> &names, const Ends &wanted) {
  std::map<std::string, std::vector<Link>> reached{{wanted.source, {}}};
  std::deque<std::string> open{wanted.source};
  while (!open.empty() && !reached.contains(wanted.target)) {
    const std::string here = open.front();
    open.pop_front();
    for (const std::string &name : names) {
      const auto ends = ends_of(name);
      if (!ends || (ends->source != here && ends->target != here)) {
        continue;
      }
      const bool inverse = ends->target == here;
      const std::string &next = inverse ? ends->source : ends->target;
      if (reached.contains(next)) {
        continue;
      }
      std::vector<Link> chain = reached[here];
      chain.push_back({name, inverse});
      reached.emplace(next, std::move(chain));
      open.push_back(next);
    }
  }
  const auto it = reached.find(wanted.target);
  return it == reached.end() || it->second.empty() ? std::nullopt : std::optional(it->second);
}

std::optional<NamedRigid> evaluate(const SequenceFrame &frame, const std::vector<Link> &chain) {
  NamedRigid T;
  for (const Link &link : chain) {
    const auto it = frame.transforms.find(link.name);
    if (it == frame.transforms.end() || !it->second.valid) {
      return std::nullopt;
    }
    const NamedRigid &recorded = it->second.pose;
    using geometry::frame::Source;
    using geometry::frame::Target;
    // Frames are names here, not types, so each step states its frames.
    const NamedRigid step = link.inverse ? recorded.inverse().as<Target, Source>() : recorded;
    T = (step.as<Target, geometry::frame::Tool>() * T.as<geometry::frame::Tool, Source>());
  }
  return T;
}

} // namespace

std::vector<std::string> TransformSequence::names() const {
  std::set<std::string> seen;
  for (const SequenceFrame &frame : frames) {
    for (const auto &[name, entry] : frame.transforms) {
      seen.insert(name);
    }
  }
  return {seen.begin(), seen.end()};
}

base::Result<PoseSeries> TransformSequence::series(std::string_view name) const {
  const std::vector<std::string> recorded = names();
  const auto wanted = ends_of(name);
  const auto chain = wanted ? find_chain(recorded, *wanted) : std::nullopt;
  if (!chain) {
    std::string list;
    for (const std::string &each : recorded) {
      list += (list.empty() ? "" : ", ") + each;
    }
    const std::string problem =
        name.empty() ? "which transform is meant" : "no transform \"" + std::string(name) + "\"";
    return base::failure(file.string() + ": " + problem + "; the recording has " + list +
                         ", their inverses and chains");
  }
  PoseSeries out;
  out.transform = std::string(name);
  for (const SequenceFrame &frame : frames) {
    if (auto pose = evaluate(frame, *chain)) {
      out.poses.push_back({frame.time_ns, *pose});
    } else {
      ++out.invalid;
    }
  }
  std::stable_sort(out.poses.begin(), out.poses.end(),
                   [](const TimedPose &a, const TimedPose &b) { return a.time_ns < b.time_ns; });
  return out;
}

base::Result<TransformSequence> read_transform_sequence(const fs::path &file) {
  std::error_code error;
  std::ifstream in(file, std::ios::binary);
  if (!in || fs::is_directory(file, error)) {
    return base::failure(file.string() + ": no such file, or it cannot be read");
  }
  return SequenceReader(file).read(in);
}

} // namespace bregma::casefile
