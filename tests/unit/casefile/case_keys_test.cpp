// docs/case.md states the keys of case.toml and tools.toml as the code reads them.
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "casefile/case.hpp"
#include "casefile/case_keys.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using bregma::base::KnownKey;

struct Row {
  bool required = false;
  std::string rule, fallback, text;
};

std::vector<std::string> cells_of(const std::string &line) {
  std::vector<std::string> cells;
  for (std::size_t from = 1; from < line.size();) {
    const std::size_t bar = std::min(line.find('|', from), line.size());
    std::string cell = line.substr(from, bar - from);
    cell.erase(0, cell.find_first_not_of(' '));
    cell.erase(cell.find_last_not_of(' ') + 1);
    cells.push_back(cell);
    from = bar + 1;
  }
  return cells;
}

std::string without_quotes(const std::string &text) {
  return text.size() >= 2 && text.front() == '`' ? text.substr(1, text.size() - 2) : text;
}

// Rows of the table of keys, by key.
std::map<std::string, Row> documented() {
  std::istringstream page(bregma::tests::read_file(BREGMA_SOURCE_DIR "/docs/case.md"));
  std::map<std::string, Row> rows;
  for (std::string line; std::getline(page, line);) {
    const auto cells = cells_of(line);
    if (line.starts_with("| `") && cells.size() == 5) {
      const bool fresh =
          rows.emplace(without_quotes(cells[0]), Row{cells[1] == "yes", cells[2], without_quotes(cells[3]), cells[4]})
              .second;
      EXPECT_TRUE(fresh) << cells[0] << " is there twice";
    }
  }
  return rows;
}

TEST(CaseKeys, ThePageStatesEachKeyAsItIsRead) {
  auto rows = documented();
  const auto keys = bregma::casefile::case_file_keys();
  EXPECT_GT(keys.size(), 30U);
  for (const KnownKey &key : keys) {
    const auto row = rows.find(key.key);
    if (row == rows.end()) {
      ADD_FAILURE() << key.key << " is not in docs/case.md: " << (key.required ? "needed, " : "") << key.rule << ", "
                    << key.fallback;
      continue;
    }
    EXPECT_EQ(row->second.required, key.required) << key.key;
    EXPECT_EQ(row->second.rule, key.rule) << key.key;
    EXPECT_EQ(row->second.fallback, key.fallback) << key.key;
    EXPECT_FALSE(row->second.text.empty()) << key.key << " is not explained";
    rows.erase(row);
  }
  for (const auto &[key, row] : rows) {
    ADD_FAILURE() << key << " is in docs/case.md, and is not read";
  }
}

TEST(CaseKeys, TheToolsOfThePageAndOfTheDemoAreRead) {
  const auto tools = bregma::casefile::read_tools(BREGMA_SOURCE_DIR "/demo/colin27/tools.toml");
  ASSERT_TRUE(tools) << tools.error().message;
  EXPECT_EQ(tools->size(), 3U);

  // The page's example, up to the end of its indented block.
  std::istringstream page(bregma::tests::read_file(BREGMA_SOURCE_DIR "/docs/case.md"));
  std::string example;
  bool inside = false;
  for (std::string line; std::getline(page, line);) {
    inside = inside || line.starts_with("    id = ");
    if (inside && !line.empty() && !line.starts_with("    ")) {
      break;
    }
    example += inside ? (line.empty() ? "" : line.substr(4)) + "\n" : "";
  }
  const bregma::test::TemporaryFolder folder;
  folder.write("case.toml", example);
  for (const char *file : {"image.nii.gz", "labels.nii.gz", "labels.txt"}) {
    folder.write(file, "");
  }
  const auto read = bregma::casefile::load_case(folder.path());
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("surfaces.scalp = \"surfaces/scalp.ply\""), std::string::npos)
      << "all but the files is right: " << read.error().message;
}

} // namespace
