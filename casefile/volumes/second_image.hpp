// Stores images in a case's folder: the planning image, and images that are registered to it.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/image_registration.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

// Copies a file that is whole in itself and states its space; writes others as NIfTI. stem: path without extension.
// Returns the file.
[[nodiscard]] base::Result<std::filesystem::path> store_image(const std::filesystem::path &source, const Volume &volume,
                                                              const std::filesystem::path &stem);

// Fraction of the scalp's vertices that lie within the image's grid.
[[nodiscard]] double covered_fraction(const surface::TriangleMesh &scalp, const image::Grid<3> &grid,
                                      const RegisteredImage &image);
inline constexpr double kMinCovered = 0.25;

// Stores the image and puts it into the case under this name; case.toml is written by save_case. Refused: an image or
// planning image that is not the registered one, less than kMinCovered of the head, and what check_case refuses.
[[nodiscard]] base::Result<void> add_image(Case &c, const std::filesystem::path &source, const Volume &volume,
                                           const ImageRegistration &registration, const std::string &name,
                                           const std::string &accepted);

} // namespace bregma::casefile
