#include "casefile/volumes/render.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Geometry>
#include <opencv2/imgcodecs.hpp>

namespace bregma::casefile {
namespace {

constexpr int kSamples = 2; // samples per side of a pixel
constexpr double kAmbient = 0.35;

// x to the right, y down, in samples; z towards the eye, in mm.
struct View {
  Eigen::Matrix3d R_view_image = Eigen::Matrix3d::Identity();
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double samples_per_mm = 1.0;
  int width = 0;
  int height = 0;

  [[nodiscard]] Eigen::Vector3d project(const Eigen::Vector3d &point) const {
    const Eigen::Vector3d v = R_view_image * (point - centre_mm);
    return {0.5 * width + samples_per_mm * v.x(), 0.5 * height - samples_per_mm * v.y(), v.z()};
  }
};

View view_of(const Scene &scene) {
  View view;
  view.width = kSamples * std::max(1, scene.width);
  view.height = kSamples * std::max(1, scene.height);
  const Eigen::Vector3d back = scene.camera.towards_eye.normalized();
  Eigen::Vector3d right = scene.camera.up.cross(back);
  if (right.norm() < 1e-6) { // looking along `up`
    right = back.unitOrthogonal();
  }
  right.normalize();
  view.R_view_image << right.transpose(), back.cross(right).transpose(), back.transpose();

  Eigen::AlignedBox3d box;
  for (const SceneMesh &mesh : scene.meshes) {
    for (const Eigen::Vector3d &vertex : mesh.mesh->vertices_mm) {
      box.extend(view.R_view_image * vertex);
    }
  }
  for (const SceneSphere &sphere : scene.spheres) {
    box.extend(view.R_view_image * sphere.centre_mm);
  }
  for (const SceneLine &line : scene.lines) {
    box.extend(view.R_view_image * line.from_mm);
    box.extend(view.R_view_image * line.to_mm);
  }
  if (box.isEmpty()) {
    return view;
  }
  view.centre_mm = view.R_view_image.transpose() * box.center();
  const Eigen::Vector3d extent = box.sizes().cwiseMax(1e-3);
  const double usable = 1.0 - 2.0 * std::clamp(scene.camera.margin, 0.0, 0.45);
  view.samples_per_mm = usable * std::min(view.width / extent.x(), view.height / extent.y());
  return view;
}

// Colours and depths of all samples.
class Canvas {
public:
  Canvas(int width, int height, const Colour &background)
      : width_(width), height_(height), colour_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                                                Eigen::Vector3f(background[0], background[1], background[2])),
        depth_(colour_.size(), -std::numeric_limits<float>::infinity()) {}

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

  void put(int x, int y, double depth, const Eigen::Vector3f &colour) {
    const std::size_t at = index(x, y);
    if (static_cast<float>(depth) > depth_[at]) {
      depth_[at] = static_cast<float>(depth);
      colour_[at] = colour;
    }
  }

  // Blends the visible part of `layer` over this canvas.
  void blend(const Canvas &layer, float opacity) {
    for (std::size_t at = 0; at < colour_.size(); ++at) {
      if (layer.depth_[at] > depth_[at]) {
        colour_[at] += opacity * (layer.colour_[at] - colour_[at]);
      }
    }
  }

  [[nodiscard]] Image image() const {
    Image out{width_ / kSamples, height_ / kSamples, {}};
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x) {
        Eigen::Vector3f sum = Eigen::Vector3f::Zero();
        for (int sample = 0; sample < kSamples * kSamples; ++sample) {
          sum += colour_[index(kSamples * x + sample % kSamples, kSamples * y + sample / kSamples)];
        }
        for (const float channel : sum / float{kSamples * kSamples}) {
          out.rgb.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(channel, 0.0F, 255.0F))));
        }
      }
    }
    return out;
  }

private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }
  int width_;
  int height_;
  std::vector<Eigen::Vector3f> colour_;
  std::vector<float> depth_;
};

// Light from the upper left behind the viewer. Both sides of a surface are lit, so that a cut shows the inside.
float brightness(const Eigen::Vector3d &view_normal) {
  static const Eigen::Vector3d light = Eigen::Vector3d(-0.4, 0.5, 0.9).normalized();
  const double facing = view_normal.z() < 0.0 ? -view_normal.dot(light) : view_normal.dot(light);
  return static_cast<float>(kAmbient + (1.0 - kAmbient) * std::max(0.0, facing));
}

std::vector<Eigen::Vector3d> vertex_normals(const surface::TriangleMesh &mesh) {
  std::vector<Eigen::Vector3d> normals(mesh.vertices_mm.size(), Eigen::Vector3d::Zero());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const Eigen::Vector3d &a = mesh.vertices_mm[static_cast<std::size_t>(t[0])];
    const Eigen::Vector3d &b = mesh.vertices_mm[static_cast<std::size_t>(t[1])];
    const Eigen::Vector3d &c = mesh.vertices_mm[static_cast<std::size_t>(t[2])];
    const Eigen::Vector3d area = (b - a).cross(c - a); // weighs by the triangle's size
    for (const int corner : t) {
      normals[static_cast<std::size_t>(corner)] += area;
    }
  }
  for (Eigen::Vector3d &normal : normals) {
    normal.normalize();
  }
  return normals;
}

struct Corner {
  Eigen::Vector3d place; // View::project
  Eigen::Vector3f colour;
  double cut_side = 0.0; // above 0: cut away
};

void draw_triangle(Canvas &canvas, const std::array<Corner, 3> &corners) {
  const Eigen::Vector3d &a = corners[0].place;
  const Eigen::Vector3d &b = corners[1].place;
  const Eigen::Vector3d &c = corners[2].place;
  const double twice_area = (b.x() - a.x()) * (c.y() - a.y()) - (c.x() - a.x()) * (b.y() - a.y());
  if (std::abs(twice_area) < 1e-12) {
    return;
  }
  const auto first = [](double v) { return std::max(0, static_cast<int>(std::ceil(v - 0.5))); };
  const auto last = [](double v, int size) { return std::min(size - 1, static_cast<int>(std::floor(v - 0.5))); };
  const int bottom = last(std::max({a.y(), b.y(), c.y()}), canvas.height());
  const int right = last(std::max({a.x(), b.x(), c.x()}), canvas.width());
  for (int y = first(std::min({a.y(), b.y(), c.y()})); y <= bottom; ++y) {
    for (int x = first(std::min({a.x(), b.x(), c.x()})); x <= right; ++x) {
      const double px = x + 0.5;
      const double py = y + 0.5;
      const double wb = ((px - a.x()) * (c.y() - a.y()) - (c.x() - a.x()) * (py - a.y())) / twice_area;
      const double wc = ((b.x() - a.x()) * (py - a.y()) - (px - a.x()) * (b.y() - a.y())) / twice_area;
      const double wa = 1.0 - wb - wc;
      if (wa < 0.0 || wb < 0.0 || wc < 0.0 ||
          wa * corners[0].cut_side + wb * corners[1].cut_side + wc * corners[2].cut_side > 0.0) {
        continue;
      }
      canvas.put(x, y, wa * a.z() + wb * b.z() + wc * c.z(),
                 static_cast<float>(wa) * corners[0].colour + static_cast<float>(wb) * corners[1].colour +
                     static_cast<float>(wc) * corners[2].colour);
    }
  }
}

Eigen::Vector3f lit(const Colour &colour, const Eigen::Vector3d &view_normal) {
  return brightness(view_normal) * Eigen::Vector3f(colour[0], colour[1], colour[2]);
}

void draw_mesh(Canvas &canvas, const View &view, const SceneMesh &item) {
  const surface::TriangleMesh &mesh = *item.mesh;
  const std::vector<Eigen::Vector3d> normals = vertex_normals(mesh);
  std::vector<Corner> corners(mesh.vertices_mm.size());
  const bool one_colour = item.vertex_colours.size() != corners.size();
  const Colour common = item.vertex_colours.empty() ? Colour{200, 200, 200} : item.vertex_colours.front();
  for (std::size_t at = 0; at < corners.size(); ++at) {
    corners[at].place = view.project(mesh.vertices_mm[at]);
    corners[at].colour = lit(one_colour ? common : item.vertex_colours[at], view.R_view_image * normals[at]);
    corners[at].cut_side = item.cut ? item.cut_normal.dot(mesh.vertices_mm[at] - item.cut_point_mm) : 0.0;
  }
  for (const Eigen::Vector3i &t : mesh.triangles) {
    draw_triangle(canvas, {corners[static_cast<std::size_t>(t[0])], corners[static_cast<std::size_t>(t[1])],
                           corners[static_cast<std::size_t>(t[2])]});
  }
}

void draw_sphere(Canvas &canvas, const View &view, const SceneSphere &sphere) {
  const Eigen::Vector3d centre = view.project(sphere.centre_mm);
  const double radius = sphere.radius_mm * view.samples_per_mm;
  for (int y = static_cast<int>(centre.y() - radius); y <= static_cast<int>(centre.y() + radius); ++y) {
    for (int x = static_cast<int>(centre.x() - radius); x <= static_cast<int>(centre.x() + radius); ++x) {
      const double dx = (x + 0.5 - centre.x()) / radius;
      const double dy = (y + 0.5 - centre.y()) / radius;
      const double rest = 1.0 - dx * dx - dy * dy;
      if (rest < 0.0 || x < 0 || y < 0 || x >= canvas.width() || y >= canvas.height()) {
        continue;
      }
      canvas.put(x, y, centre.z() + sphere.radius_mm * std::sqrt(rest), lit(sphere.colour, {dx, -dy, std::sqrt(rest)}));
    }
  }
}

// A chain of spheres that are close enough to look like a rod.
void draw_line(Canvas &canvas, const View &view, const SceneLine &line) {
  const double length = (line.to_mm - line.from_mm).norm();
  const int steps = 1 + static_cast<int>(length / std::max(0.05, 0.25 * line.radius_mm));
  for (int step = 0; step <= steps; ++step) {
    const double fraction = static_cast<double>(step) / steps;
    draw_sphere(canvas, view, {line.from_mm + fraction * (line.to_mm - line.from_mm), line.radius_mm, line.colour});
  }
}

} // namespace

Image render(const Scene &scene) {
  const View view = view_of(scene);
  Canvas canvas(view.width, view.height, scene.background);
  for (const SceneMesh &mesh : scene.meshes) {
    if (mesh.opacity >= 1.0) {
      draw_mesh(canvas, view, mesh);
    }
  }
  for (const SceneSphere &sphere : scene.spheres) {
    draw_sphere(canvas, view, sphere);
  }
  for (const SceneLine &line : scene.lines) {
    draw_line(canvas, view, line);
  }
  for (const SceneMesh &mesh : scene.meshes) {
    if (mesh.opacity < 1.0) {
      Canvas layer(view.width, view.height, scene.background);
      draw_mesh(layer, view, mesh);
      canvas.blend(layer, static_cast<float>(mesh.opacity));
    }
  }
  return canvas.image();
}

base::Result<std::vector<std::uint8_t>> encode_png(const Image &image) {
  if (image.width < 1 || image.height < 1 ||
      image.rgb.size() != 3 * static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height)) {
    return base::failure("a picture of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                         " pixels cannot be written");
  }
  cv::Mat pixels(image.height, image.width, CV_8UC3);
  for (std::size_t at = 0; at < image.rgb.size(); at += 3) { // OpenCV stores blue first
    pixels.data[at] = image.rgb[at + 2];
    pixels.data[at + 1] = image.rgb[at + 1];
    pixels.data[at + 2] = image.rgb[at];
  }
  std::vector<std::uint8_t> png;
  try {
    if (!cv::imencode(".png", pixels, png)) {
      return base::failure("the picture cannot be encoded");
    }
  } catch (const cv::Exception &error) {
    return base::failure("the picture cannot be encoded: " + error.err);
  }
  return png;
}

} // namespace bregma::casefile
