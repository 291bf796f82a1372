// What `bregma mri report` makes of what it receives: malformed slices, incomplete series, slices that are published
// again, and a page without data.
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "clients/cli/mri/report/run_figures.hpp"
#include "clients/cli/mri/report/run_page.hpp"
#include "clients/cli/mri/report/run_pictures.hpp"
#include "idl/names.hpp"

namespace {

using namespace bregma;
using namespace bregma::cli::mri_report;

constexpr std::uint32_t kSide = 32;

class Slices {
public:
  Slices() : pixels_(std::size_t{kSide} * kSide, 500) {}
  wire::ImageSlice slice(const char *protocol, std::uint32_t series, std::uint32_t index, std::uint32_t count,
                         std::uint64_t coils_on = 0) {
    wire::ImageSlice out{};
    (void)wire::set_name(out.protocol, protocol);
    out.series = series;
    out.index = index;
    out.count = count;
    out.columns = out.rows = kSide;
    out.pixels._buffer = pixels_.data();
    out.pixels._length = out.pixels._maximum = kSide * kSide;
    out.spacing_mm[0] = out.spacing_mm[1] = out.thickness_mm = 1.5;
    out.T_scanner_slice = {{1, 0, 0, 0}, {-24, -24, 1.5 * index}};
    out.coils_on = coils_on;
    out.patient_position = bregma_wire_POSITION_HFS;
    return out;
  }

private:
  std::vector<std::uint16_t> pixels_;
};

TEST(MriReport, SeriesAreCollectedAndWhatIsMalformedIsCounted) {
  Slices make;
  RunRecord record;
  for (std::uint32_t k = 1; k <= 4; ++k) {
    record.add(make.slice("top", 1, k, 4));
  }
  for (std::uint32_t k = 1; k <= 3; ++k) {
    record.add(make.slice("top", 2, k, 4, 0xF0));
  }
  EXPECT_EQ(record.pair_of("top").foreground, nullptr) << "a slice is missing";
  record.add(make.slice("top", 2, 4, 4, 0xF0));
  record.add(make.slice("top", 2, 4, 4, 0xF0)); // twice
  wire::ImageSlice wrong = make.slice("top", 2, 9, 4);
  record.add(wrong);
  wrong = make.slice("top", 2, 1, 4);
  wrong.pixels._length = 5;
  record.add(wrong);
  EXPECT_EQ(record.left_out(), 3U);
  const auto pair = record.pair_of("top");
  ASSERT_NE(pair.foreground, nullptr);
  EXPECT_EQ(pair.background->header.series, 1U);
  EXPECT_EQ(pair.foreground->header.series, 2U);
  const auto stack = pair.background->stack();
  ASSERT_TRUE(stack);
  EXPECT_EQ(stack->size, (std::array<int, 3>{32, 32, 4}));
  EXPECT_NEAR((stack->point_mm(Eigen::Vector3d(1, 2, 3)) - Eigen::Vector3d(-22.5, -21.0, 6.0)).norm(), 0.0, 1e-9);
  EXPECT_EQ(record.largest("phantom"), nullptr);
}

TEST(MriReport, AScannerThatIsStartedAgainBeginsASeries) {
  Slices make;
  RunRecord record;
  wire::ImageSlice last = make.slice("top", 1, 1, 2);
  last.frame = 7;
  record.add(last);
  for (std::uint32_t k = 1; k <= 2; ++k) {
    wire::ImageSlice again = make.slice("top", 1, k, 2);
    again.frame = k;
    record.add(again);
  }
  ASSERT_EQ(record.series().size(), 2U);
  EXPECT_TRUE(record.series().back().complete());
  EXPECT_EQ(record.left_out(), 0U);
  record.add(last);
  record.add(last);
  EXPECT_EQ(record.left_out(), 2U);
  const auto page = html_page(record, {}, {});
  ASSERT_TRUE(page) << page.error().message;
  EXPECT_NE(page->find("2 left out"), std::string::npos);
}

TEST(MriReport, ASliceThatIsPublishedAgainReplacesTheFormer) {
  Slices make;
  RunRecord record;
  wire::CorrectedSlice corrected{};
  corrected.slice = make.slice("live", 5, 3, 8);
  corrected.missing_fraction = 0.2;
  record.add(corrected);
  corrected.missing_fraction = 0.0;
  corrected.tip_status = bregma_wire_POSE_LIVE;
  corrected.tip_pixel[0] = 10.0;
  corrected.tip_pixel[1] = 12.0;
  corrected.tip_distance_mm = 0.5;
  corrected.tip_error_95_mm = 0.7;
  (void)wire::set_name(corrected.tip_tool, "Guide");
  record.add(corrected);
  record.add(make.slice("live", 5, 3, 8));
  ASSERT_EQ(record.corrected().size(), 1U);
  EXPECT_EQ(record.corrected()[0].said.missing_fraction, 0.0);
  const auto figure = tip_figure(record);
  ASSERT_TRUE(figure) << figure.error().message;
  EXPECT_NE(figure->find("with the tip of Guide"), std::string::npos);
  EXPECT_NE(figure->find("as acquired"), std::string::npos);
}

TEST(MriReport, WithoutDataNoCheckHoldsAndThePageSaysWhy) {
  const RunRecord record;
  RunInputs inputs;
  inputs.phantom_mm = geometry::Points3::Zero(3, 20);
  inputs.T_device_base = {};
  const RunAnalysis analysis = analyse(record, inputs);
  const auto judgements = judge(record, inputs, analysis);
  EXPECT_FALSE(cli::report::all_hold(judgements));
  for (const auto &one : judgements) {
    EXPECT_TRUE(!one.holds || one.name == "tips") << one.name;
  }
  const auto page = html_page(record, analysis, judgements);
  ASSERT_TRUE(page) << page.error().message;
  EXPECT_NE(page->find("no complete series of the phantom was received"), std::string::npos);
  EXPECT_NE(page->find("a check fails"), std::string::npos);
  EXPECT_NE(summary_text(record, analysis, judgements).find("FAILS"), std::string::npos);
}

TEST(MriReport, PicturesStayInsideTheirBorders) {
  Image image = grey(std::vector<std::uint8_t>(128, 255), 16, 8);
  draw_circle(image, {15.0, 7.0}, 6.0, kMarkOrange);
  draw_cross(image, {-2.0, 3.0}, 4, kMarkBlue);
  EXPECT_EQ(image.rgb.size(), 16U * 8U * 3U);
  EXPECT_EQ(image.rgb[std::size_t{3} * (3 * 16 + 2)], kMarkBlue[0]);
  const Image part = cropped(image, 12, 6, 8, 8);
  EXPECT_EQ(part.width, 8);
  EXPECT_EQ(part.height, 8);
  const ColourMap map{0.0, 2.0};
  EXPECT_EQ(map(-1.0), map(0.0));
  EXPECT_EQ(map(5.0), map(2.0));
  EXPECT_NE(map(0.0), map(1.0));
}

} // namespace
