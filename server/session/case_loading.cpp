#include "server/session/case_loading.hpp"

#include <exception>
#include <new>
#include <utility>

#include "server/session/case_checksum.hpp"

namespace bregma::server {
namespace {

LoadedFolder load(const std::filesystem::path &folder, const PrepareCase &prepare) {
  auto read = casefile::load_case(folder);
  if (!read) {
    return {.error = read.error().message, .loaded = nullptr, .prepared = nullptr, .checksum = {}};
  }
  LoadedFolder out;
  out.loaded = std::make_shared<const casefile::Case>(std::move(*read));
  auto prepared = prepare(out.loaded);
  if (!prepared) {
    return {.error = prepared.error().message, .loaded = nullptr, .prepared = nullptr, .checksum = {}};
  }
  out.prepared = std::move(*prepared);
  out.checksum = case_checksum(*out.loaded);
  return out;
}

} // namespace

std::shared_ptr<JobResult<LoadedFolder>> load_folder(const std::filesystem::path &folder, const PrepareCase &prepare,
                                                     const Executor &executor) {
  auto result = std::make_shared<JobResult<LoadedFolder>>();
  execute(executor, Work::kLoad, [result, folder, prepare] {
    LoadedFolder out;
    try {
      out = load(folder, prepare);
    } catch (const std::bad_alloc &) {
      out.error = folder.string() + ": there is not enough memory to load this case";
    } catch (const std::exception &problem) {
      out.error = folder.string() + ": cannot be loaded: " + problem.what();
    }
    result->set(std::move(out));
  });
  return result;
}

} // namespace bregma::server
