// Loading of a case by another thread: the folder, and what the loops need of it. A folder may hang for ever (a network
// that is gone), and a case may not fit into memory; both refuse the case and nothing else.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "server/session/work.hpp"

namespace bregma::server {

// What the owner of the loops makes of a case.
class PreparedCase {
public:
  virtual ~PreparedCase() = default;
};

// Runs on a loading thread. An error rejects the case.
using PrepareCase =
    std::function<base::Result<std::shared_ptr<PreparedCase>>(std::shared_ptr<const casefile::Case> loaded)>;

struct LoadedFolder {
  std::string error; // empty: it was loaded
  std::shared_ptr<const casefile::Case> loaded;
  std::shared_ptr<PreparedCase> prepared;
  std::string checksum; // case_checksum() of the loaded case
};

// Starts the loading. Errors: the case's own, those of prepare, or an exception.
[[nodiscard]] std::shared_ptr<JobResult<LoadedFolder>>
load_folder(const std::filesystem::path &folder, const PrepareCase &prepare, const Executor &executor);

} // namespace bregma::server
