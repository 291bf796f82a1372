// The layout of case.toml and tools.toml, as the code reads them.
#pragma once

#include <vector>

#include "base/table_reader.hpp"

namespace bregma::casefile {

// The keys of case.toml as load_case reads them; those of [[tools]] are also the keys of the file that read_tools
// reads.
[[nodiscard]] std::vector<base::KnownKey> case_file_keys();

} // namespace bregma::casefile
