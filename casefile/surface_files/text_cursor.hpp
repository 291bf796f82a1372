// Reads a text word by word and tracks the line. Private to this library.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include "casefile/surface_files/raw_surface.hpp"

namespace bregma::casefile::detail {

class TextCursor {
public:
  explicit TextCursor(std::string_view text, int first_line = 1) : text_(text), next_line_(first_line) {}

  [[nodiscard]] std::string_view word();           // the next; empty at the end
  [[nodiscard]] std::string_view rest_of_line();   // after the last word; continues after the line's end
  [[nodiscard]] int line() const { return line_; } // line of the last word
  [[nodiscard]] std::size_t position() const { return at_; }
  void skip_to(std::size_t position); // forwards; lines in binary data are not counted
  [[nodiscard]] std::size_t left() const { return text_.size() - at_; }

  // `what` names it in the message: "vertex 3: y".
  [[nodiscard]] Parsed<double> number(const std::string &what); // finite
  // A count in a file that may declare more than it holds: a whole number from 0, refused where `min_bytes_each` bytes
  // per element exceed the rest of the file.
  [[nodiscard]] Parsed<std::size_t> count(const std::string &what, std::size_t min_bytes_each);
  [[nodiscard]] Parsed<Eigen::Vector3d> point(const std::string &what);
  // A vertex's number below `vertices`.
  [[nodiscard]] Parsed<int> corner(const std::string &what, std::size_t vertices);

private:
  std::string_view text_;
  std::size_t at_ = 0;
  int next_line_ = 1;
  int line_ = 1;
};

// As much of a word as a message can hold, without control characters.
[[nodiscard]] std::string in_quotes(std::string_view word);

} // namespace bregma::casefile::detail
