// What the rooms that read files return: a value, or a sentence for the person who gave the file.
#pragma once

#include <string>

#include <tl/expected.hpp>

namespace bregma::base {

struct Error {
  std::string message; // names the file, where known the line and the field, the value, and what is wrong with it
};

template <class T> using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> failure(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message)});
}

} // namespace bregma::base
