// Result of functions that read files: a value, or an error sentence for the user.
#pragma once

#include <string>

#include <tl/expected.hpp>

namespace bregma::base {

struct Error {
  std::string message; // names the file, if known the line and the field, the value, and the problem
};

template <class T> using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> failure(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message)});
}

} // namespace bregma::base
