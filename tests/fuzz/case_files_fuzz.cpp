// Arbitrary bytes as the case.toml of a complete folder, as a list of tools, or as a program's configuration: nothing
// crashes, what is accepted satisfies the checks, and a refused configuration changes nothing. A surface or a plan of
// the folder that is cut is refused; TOML states no size.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/parameters.hpp"
#include "casefile/case.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

// The folder of a small case. Its surfaces are as coarse as they can be: each input reads them all.
class CaseFolder {
public:
  CaseFolder() {
    casefile::Case c = tests::sample_case(folder_.path());
    for (auto &structure : c.structures) {
      structure.mesh = tests::sphere({-30, 0, 30}, 25, 0);
    }
    c.scalp.mesh = tests::sphere({0, 0, 0}, 90, 0);
    c.brain.mesh = tests::sphere({0, 0, 5}, 70, 0);
    static_cast<void>(folder_.write("image.nii.gz", ""));
    require(casefile::save_case(c).has_value());
    for (const auto &entry : std::filesystem::recursive_directory_iterator(folder_.path())) {
      if (const auto name = entry.path().lexically_relative(folder_.path());
          name.extension() == ".ply" || name.extension() == ".json") {
        parts_.emplace_back(name, tests::read_file(entry.path()));
      } else if (name == "case.toml") {
        toml_ = tests::read_file(entry.path());
      }
    }
    std::sort(parts_.begin(), parts_.end());
    require(parts_.size() > 6 && load());
  }
  void load(std::string_view toml) const {
    static_cast<void>(folder_.write("case.toml", toml));
    static_cast<void>(load());
    static_cast<void>(folder_.write("case.toml", toml_));
  }
  // One part of the folder, cut before the end of what it states.
  void cut(std::size_t number) const {
    const auto &[name, whole] = parts_[number % parts_.size()];
    const std::size_t end = name.extension() == ".json" ? whole.find_last_of('}') : whole.size() - 1;
    static_cast<void>(folder_.write(name, std::string_view(whole).substr(0, number / parts_.size() % (end + 1))));
    require(!load());
    static_cast<void>(folder_.write(name, whole));
  }
  void tools(std::string_view toml) const {
    const auto read = casefile::read_tools(folder_.write("tools.toml", toml));
    require(read || !read.error().message.empty());
    for (const auto &tool : read ? *read : std::vector<casefile::ToolModel>()) {
      require(tool.nominal_tip_mm.allFinite() && tool.axis.allFinite() && tool.normal.allFinite());
    }
  }

private:
  bool load() const {
    const auto loaded = casefile::load_case(folder_.path());
    require(loaded || !loaded.error().message.empty());
    require(!loaded || casefile::check_case(*loaded).has_value());
    return loaded.has_value();
  }

  test::TemporaryFolder folder_;
  std::string toml_;
  std::vector<std::pair<std::filesystem::path, std::string>> parts_; // path in the folder, and content
};

void configure(std::string_view toml) {
  double rate_hz = 10.0;
  std::int64_t count = 3;
  bool on = true;
  std::string name = "a", kind = "one";
  base::ParameterSet set("program");
  set.number("part.rate_hz", &rate_hz, "Hz", 1, 1000, "A rate")
      .integer("part.count", &count, "", 0, 100, "A count")
      .flag("part.on", &on, "A flag")
      .string("other.name", &name, "A name")
      .choice("other.kind", &kind, {"one", "two"}, "A kind");
  const std::string before = set.to_toml();
  const auto loaded = set.load_text(toml, "a.toml");
  require(loaded || (!loaded.error().message.empty() && set.to_toml() == before));
  require(rate_hz >= 1.0 && rate_hz <= 1000.0 && count >= 0 && count <= 100 && (kind == "one" || kind == "two"));
  const auto again = set.load_text(set.to_toml(), "b.toml");
  require(again.has_value());
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const CaseFolder folder;
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data) + 1, size - 1);
  switch (static_cast<unsigned>(data[0] - '0') % 4) { // the seeds begin with the digits 0 to 3
  case 0:
    folder.load(content);
    break;
  case 1:
    folder.tools(content);
    break;
  case 2:
    configure(content);
    break;
  default:
    folder.cut(std::hash<std::string_view>()(content));
    break;
  }
  return 0;
}
