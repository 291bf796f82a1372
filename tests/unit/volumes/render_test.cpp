#include "casefile/volumes/render.hpp"

#include <gtest/gtest.h>

namespace bregma::casefile {
namespace {

using surface::TriangleMesh;

// A square plate normal to the view of an eye at +y, `at_mm` in front of the origin.
TriangleMesh plate(double at_mm, double half_mm) {
  return {
      {{-half_mm, at_mm, -half_mm}, {half_mm, at_mm, -half_mm}, {half_mm, at_mm, half_mm}, {-half_mm, at_mm, half_mm}},
      {{0, 2, 1}, {0, 3, 2}}};
}

SceneMesh item(const TriangleMesh &mesh, const Colour &colour) {
  SceneMesh out;
  out.mesh = &mesh;
  out.vertex_colours = {colour};
  return out;
}

Scene empty_scene() {
  Scene scene;
  scene.width = 100;
  scene.height = 80;
  return scene;
}

Colour pixel(const Image &image, int x, int y) {
  const std::size_t at =
      3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x));
  return {image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]};
}

bool is_mostly(const Colour &colour, std::size_t channel) {
  return colour[channel] > 60 && colour[(channel + 1) % 3] < 20 && colour[(channel + 2) % 3] < 20;
}

TEST(Render, TheNearerSurfaceHidesTheFarther) {
  const TriangleMesh near = plate(10.0, 5.0);
  const TriangleMesh far = plate(-10.0, 20.0);
  for (const bool near_first : {true, false}) {
    Scene scene = empty_scene();
    scene.meshes = {item(near, {255, 0, 0}), item(far, {0, 255, 0})};
    if (!near_first) {
      std::swap(scene.meshes[0], scene.meshes[1]);
    }
    const Image image = render(scene);
    ASSERT_EQ(100, image.width);
    ASSERT_EQ(80, image.height);
    EXPECT_TRUE(is_mostly(pixel(image, 50, 40), 0));
    EXPECT_TRUE(is_mostly(pixel(image, 50, 40 - 30), 1)) << "the far plate is larger and shows around the near one";
    EXPECT_EQ((Colour{255, 255, 255}), pixel(image, 2, 2));
  }
}

// In a view from the front the patient's right is on the viewer's left, and superior is up.
TEST(Render, SidesAreThoseOfAViewerInFront) {
  const TriangleMesh far = plate(-10.0, 20.0);
  Scene scene = empty_scene();
  scene.meshes = {item(far, {200, 200, 200})};
  scene.spheres = {{{15.0, 0.0, 0.0}, 3.0, {255, 0, 0}}, {{0.0, 0.0, 15.0}, 3.0, {0, 0, 255}}};
  const Image image = render(scene);
  const double pixels_per_mm = 0.9 * 80 / 40.0;
  EXPECT_TRUE(is_mostly(pixel(image, 50 - static_cast<int>(15 * pixels_per_mm), 40), 0));
  EXPECT_TRUE(is_mostly(pixel(image, 50, 40 - static_cast<int>(15 * pixels_per_mm)), 2));
}

TEST(Render, TranslucentSurfacesShowTheBackground) {
  const TriangleMesh near = plate(10.0, 20.0);
  const TriangleMesh far = plate(-10.0, 20.0);
  Scene scene = empty_scene();
  scene.meshes = {item(near, {255, 0, 0}), item(far, {0, 255, 0})};
  scene.meshes[0].opacity = 0.5;
  const Colour mixed = pixel(render(scene), 50, 40);
  EXPECT_GT(mixed[0], 40);
  EXPECT_GT(mixed[1], 40);
  // An object in front of a translucent surface is not tinted.
  scene.spheres = {{{0.0, 15.0, 0.0}, 4.0, {0, 0, 255}}};
  EXPECT_TRUE(is_mostly(pixel(render(scene), 50, 40), 2));
}

TEST(Render, ACutShowsTheInside) {
  const TriangleMesh near = plate(10.0, 20.0);
  const TriangleMesh far = plate(-10.0, 20.0);
  Scene scene = empty_scene();
  scene.meshes = {item(near, {255, 0, 0}), item(far, {0, 255, 0})};
  scene.meshes[0].cut = true; // removes the half on the patient's right
  const Image image = render(scene);
  EXPECT_TRUE(is_mostly(pixel(image, 35, 40), 1));
  EXPECT_TRUE(is_mostly(pixel(image, 65, 40), 0));
}

TEST(Render, ColoursOfVerticesBlendAcrossATriangle) {
  const TriangleMesh mesh = plate(0.0, 20.0);
  Scene scene = empty_scene();
  scene.meshes = {item(mesh, {})};
  scene.meshes[0].vertex_colours = {{255, 0, 0}, {0, 0, 255}, {0, 0, 255}, {255, 0, 0}}; // left red, right blue
  const Image image = render(scene);
  EXPECT_GT(pixel(image, 50 + 30, 40)[0], pixel(image, 50 - 30, 40)[0]);
  EXPECT_LT(pixel(image, 50 + 30, 40)[2], pixel(image, 50 - 30, 40)[2]);
}

TEST(Render, AnEmptySceneIsTheBackground) {
  Scene scene = empty_scene();
  scene.background = {1, 2, 3};
  EXPECT_EQ((Colour{1, 2, 3}), pixel(render(scene), 50, 40));
}

TEST(Png, HasThePngSignatureAndRefusesAnEmptyPicture) {
  const auto png = encode_png(render(empty_scene()));
  ASSERT_TRUE(png);
  ASSERT_GT(png->size(), 24U);
  EXPECT_EQ(0x89, (*png)[0]);
  EXPECT_EQ('P', (*png)[1]);
  EXPECT_EQ(100, (*png)[19]); // width, big endian, of the IHDR chunk
  EXPECT_EQ("a picture of 0 x 0 pixels cannot be written", encode_png({}).error().message);
}

} // namespace
} // namespace bregma::casefile
