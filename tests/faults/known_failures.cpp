#include "tests/faults/known_failures.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

namespace bregma::faults {
namespace {

std::string trimmed(const std::string &text) {
  const std::size_t first = text.find_first_not_of(' ');
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(' ') - first + 1);
}

// "cell | session | rule | reason"
KnownFailure entry_of(const std::string &line) {
  std::vector<std::string> fields;
  std::istringstream stream(line);
  for (std::string field; std::getline(stream, field, '|');) {
    fields.push_back(trimmed(field));
  }
  const auto session = std::find_if(std::begin(kAllSessions), std::end(kAllSessions),
                                    [&](During one) { return fields.size() == 4 && fields[1] == name_of(one); });
  const bool known_session = session != std::end(kAllSessions);
  if (fields.size() != 4 || (!known_session && fields[1] != "*")) {
    throw std::runtime_error(std::string(BREGMA_KNOWN_FAILURES) + ": '" + line +
                             "': cell | session or * | rule | reason");
  }
  return {fields[0], known_session ? std::optional(*session) : std::nullopt, fields[2], fields[3]};
}

std::vector<KnownFailure> read() {
  std::ifstream file(BREGMA_KNOWN_FAILURES);
  if (!file) {
    throw std::runtime_error(std::string(BREGMA_KNOWN_FAILURES) + " cannot be read");
  }
  std::vector<KnownFailure> out;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty() && line.front() != '#') {
      out.push_back(entry_of(line));
    }
  }
  return out;
}

} // namespace

const std::vector<KnownFailure> &known_failures() {
  static const std::vector<KnownFailure> kList = read();
  return kList;
}

const KnownFailure *find_known(const Cell &cell, During session, const Violation &violation) {
  const KnownFailure *out = nullptr;
  for (const KnownFailure &known : known_failures()) {
    const bool matches = known.rule == violation.rule && cell.name().starts_with(known.cell) &&
                         (!known.session || known.session == session);
    if (matches && (out == nullptr || known.cell.size() > out->cell.size())) {
      out = &known; // the most specific one
    }
  }
  return out;
}

} // namespace bregma::faults
