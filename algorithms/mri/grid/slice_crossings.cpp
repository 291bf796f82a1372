#include "algorithms/mri/grid/slice_crossings.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <opencv2/imgproc.hpp>

namespace bregma::mri {

namespace {

constexpr double kSample_mm = 0.5;      // images are enlarged to about this
constexpr double kThresholdShare = 0.2; // of the range, by which a bar differs from the mean around it
constexpr double kBlur_mm = 0.5;
constexpr double kMinArea = 1.5;   // of a bar one cell long: smaller spots are noise, or bars seen end on
constexpr double kArmRadius = 0.3; // of a cell: radius at which the bars that leave a crossing are counted

int odd(double value) { return std::max(3, 2 * static_cast<int>(std::lround(0.5 * (value - 1.0))) + 1); }

cv::Mat disc(double diameter_px) {
  const int size = odd(diameter_px);
  return cv::getStructuringElement(cv::MORPH_ELLIPSE, {size, size});
}

// The eight neighbours in order around a pixel.
std::array<int, 8> ring(const cv::Mat &image, int y, int x) {
  const auto at = [&](int dy, int dx) { return image.at<unsigned char>(y + dy, x + dx) != 0 ? 1 : 0; };
  return {at(-1, 0), at(-1, 1), at(0, 1), at(1, 1), at(1, 0), at(1, -1), at(0, -1), at(-1, -1)};
}

int transitions(const std::array<int, 8> &n) {
  int out = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    out += n[i] == 0 && n[(i + 1) % 8] == 1 ? 1 : 0;
  }
  return out;
}

void remove_spots(cv::Mat &binary, double min_area) {
  cv::Mat labels, statistics, centroids;
  const int count = cv::connectedComponentsWithStats(binary, labels, statistics, centroids);
  for (int y = 0; y < binary.rows; ++y) {
    for (int x = 0; x < binary.cols; ++x) {
      const int label = labels.at<int>(y, x);
      if (label > 0 && label < count && statistics.at<int>(label, cv::CC_STAT_AREA) < min_area) {
        binary.at<unsigned char>(y, x) = 0;
      }
    }
  }
}

// Bars that leave a crossing: a circle around it is crossed by each once.
int arms(const cv::Mat &binary, double x, double y, double radius) {
  constexpr int kAngles = 72;
  int out = 0;
  bool before = false;
  for (int i = 0; i <= kAngles; ++i) {
    const double angle = 2.0 * CV_PI * i / kAngles;
    const int column = static_cast<int>(std::lround(x + radius * std::cos(angle)));
    const int row = static_cast<int>(std::lround(y + radius * std::sin(angle)));
    const bool on = column >= 0 && row >= 0 && column < binary.cols && row < binary.rows &&
                    binary.at<unsigned char>(row, column) != 0;
    out += i > 0 && on && !before ? 1 : 0;
    before = on;
  }
  return out;
}

// Thinning to lines of one pixel [Zhang 1984]; the border stays empty.
void skeletonise(cv::Mat &image) {
  for (cv::Mat border : {image.row(0), image.row(image.rows - 1), image.col(0), image.col(image.cols - 1)}) {
    border.setTo(0);
  }
  std::vector<cv::Point> gone;
  bool first = true;
  for (int quiet = 0; quiet < 2; first = !first) {
    gone.clear();
    for (int y = 1; y + 1 < image.rows; ++y) {
      for (int x = 1; x + 1 < image.cols; ++x) {
        if (image.at<unsigned char>(y, x) == 0) {
          continue;
        }
        const auto n = ring(image, y, x); // 0 N, 2 E, 4 S, 6 W
        int count = 0;
        for (const int v : n) {
          count += v;
        }
        const bool open = first ? n[0] * n[2] * n[4] == 0 && n[2] * n[4] * n[6] == 0
                                : n[0] * n[2] * n[6] == 0 && n[0] * n[4] * n[6] == 0;
        if (count >= 2 && count <= 6 && open && transitions(n) == 1) {
          gone.emplace_back(x, y);
        }
      }
    }
    for (const cv::Point &p : gone) {
      image.at<unsigned char>(p) = 0;
    }
    quiet = gone.empty() ? quiet + 1 : 0;
  }
}

} // namespace

std::vector<Eigen::Vector2d> slice_crossings(const std::vector<float> &values, int columns, int rows,
                                             const Eigen::Vector2d &pixel_mm, const SliceOptions &options,
                                             std::vector<CrossingStage> *stages) {
  const auto show = [stages](const char *name, const cv::Mat &image) {
    if (stages != nullptr) {
      stages->push_back({name, image.cols, image.rows, {image.begin<unsigned char>(), image.end<unsigned char>()}});
    }
  };
  const cv::Mat slice(rows, columns, CV_32F, const_cast<float *>(values.data())); // NOLINT: read only
  double low = 0.0, high = 0.0;
  cv::minMaxLoc(slice, &low, &high);
  if (!(high > low)) {
    return {};
  }
  cv::Mat bytes, enlarged, binary;
  slice.convertTo(bytes, CV_8U, 255.0 / (high - low), -255.0 * low / (high - low));
  const double scale_x = pixel_mm.x() / kSample_mm, scale_y = pixel_mm.y() / kSample_mm;
  cv::resize(bytes, enlarged, {}, scale_x, scale_y, cv::INTER_CUBIC);
  show("original", enlarged);
  cv::GaussianBlur(enlarged, enlarged, {}, kBlur_mm / kSample_mm);
  cv::adaptiveThreshold(enlarged, binary, 255, cv::ADAPTIVE_THRESH_MEAN_C,
                        options.bright ? cv::THRESH_BINARY : cv::THRESH_BINARY_INV, odd(options.cell_mm / kSample_mm),
                        (options.bright ? -1.0 : 1.0) * kThresholdShare * 255.0);
  show("binary", binary);
  cv::morphologyEx(binary, binary, cv::MORPH_CLOSE, disc(0.6 * options.bar_mm / kSample_mm));
  show("closed", binary);
  cv::dilate(binary, binary, disc(0.5 * options.bar_mm / kSample_mm));
  remove_spots(binary, kMinArea * options.bar_mm * options.cell_mm / (kSample_mm * kSample_mm));
  show("dilated, spots removed", binary);
  const cv::Mat bars = binary.clone();
  skeletonise(binary);
  show("skeleton", binary);
  cv::Mat branches = cv::Mat::zeros(binary.size(), CV_8U);
  for (int y = 1; y + 1 < binary.rows; ++y) {
    for (int x = 1; x + 1 < binary.cols; ++x) {
      if (binary.at<unsigned char>(y, x) != 0 && transitions(ring(binary, y, x)) >= 3) {
        branches.at<unsigned char>(y, x) = 255;
      }
    }
  }
  show("branch points", branches);
  cv::dilate(branches, branches, disc(2.0 * options.bar_mm / kSample_mm));
  show("branch points dilated", branches);
  cv::Mat labels, statistics, centroids;
  const int count = cv::connectedComponentsWithStats(branches, labels, statistics, centroids);
  std::vector<Eigen::Vector2d> out;
  for (int i = 1; i < count; ++i) { // 0 is the background
    const double x = centroids.at<double>(i, 0), y = centroids.at<double>(i, 1);
    if (arms(bars, x, y, kArmRadius * options.cell_mm / kSample_mm) >= 3) { // a spur of the skeleton has fewer
      out.emplace_back((x + 0.5) / scale_x - 0.5, (y + 0.5) / scale_y - 0.5);
    }
  }
  return out;
}

} // namespace bregma::mri
