// Private to casefile/volumes: the mask of one object from voxels.
#pragma once

#include <functional>
#include <string_view>

#include "casefile/volumes/surface.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

// 1 inside the object, 0 outside, smooth between: the boundary is at 0.5. Padded, so that the object never touches the
// boundary of the grid.
struct Field {
  Volume grid;            // T_image_index holds for this grid's own indices
  double threshold = 0.0; // threshold of the image that was used
};

// Reports the progress (0 to 1) and throws where the caller stops the work.
using Step = std::function<void(double, std::string_view)>;

// Both may throw (ITK's exceptions, the step's).
[[nodiscard]] base::Result<Field> object_field(const Volume &volume, const SurfaceOptions &options, const Step &step);
[[nodiscard]] base::Result<Field> region_field(const LabelVolume &volume, std::span<const std::int16_t> labels,
                                               const SurfaceOptions &options, const Step &step);

} // namespace bregma::casefile
