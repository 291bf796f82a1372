// docs/configuration.md is the table that `bregmad --print-config-table` prints.
#include <gtest/gtest.h>

#include "server/config.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

TEST(ConfigurationPage, ContainsTheTableOfTheDeclaredParameters) {
  bregma::server::Config config;
  const std::string table = declare(config).to_markdown();
  const std::string page = bregma::tests::read_file(BREGMA_SOURCE_DIR "/docs/configuration.md");
  EXPECT_NE(page.find(table), std::string::npos) << "bregmad --print-config-table prints another one:\n" << table;
}

} // namespace
