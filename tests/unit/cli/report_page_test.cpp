// Plots and the HTML page of `bregma report`.
#include <cmath>

#include "base/plots.hpp"
#include "clients/cli/report/figures.hpp"
#include "clients/cli/report/html_report.hpp"
#include "clients/cli/report/page_parts.hpp"
#include "clients/cli/report/tip_analysis.hpp"

#include <gtest/gtest.h>

namespace {

using namespace bregma;
using namespace bregma::base;
using namespace bregma::cli::report;

std::size_t count_of(const std::string &text, std::string_view what) {
  std::size_t count = 0;
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) {
    ++count;
  }
  return count;
}

TEST(Plots, TicksAreRoundAndInsideTheRange) {
  EXPECT_EQ(linear_ticks(0.0, 1.0, 5), (std::vector<double>{0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0}));
  EXPECT_EQ(linear_ticks(-3.0, 7.0, 5), (std::vector<double>{-2.0, 0.0, 2.0, 4.0, 6.0}));
  EXPECT_TRUE(linear_ticks(1.0, 1.0, 5).empty());
  EXPECT_TRUE(linear_ticks(0.0, std::nan(""), 5).empty());
  const auto decades = logarithmic_ticks(0.01, 1000.0);
  ASSERT_EQ(decades.size(), 6U);
  EXPECT_NEAR(decades.front(), 0.01, 1e-12);
  EXPECT_NEAR(decades.back(), 1000.0, 1e-9);
  EXPECT_EQ(logarithmic_ticks(0.9, 11.0).size(), 4U) << "1, 2, 5, 10";
  EXPECT_TRUE(logarithmic_ticks(0.0, 10.0).empty()) << "zero has no place on a logarithmic axis";
}

TEST(Plots, LineIsBrokenWhereAValueIsNotKnown) {
  Plot plot;
  Series line;
  line.points = {{0, 1}, {1, 2}, {2, std::nan("")}, {3, 2}, {4, 1}};
  plot.series = {line};
  const std::string svg = plot_svg(plot, {400, 200});
  const auto path = svg.substr(svg.find("<path d='"));
  EXPECT_EQ(count_of(path.substr(0, path.find("fill")), "M"), 2U) << path;
  EXPECT_EQ(svg.find("nan"), std::string::npos);
}

TEST(Plots, PeakSurvivesWhenThereAreMorePointsThanPixels) {
  Plot plot;
  plot.y.from = 0.0;
  plot.y.to = 10.0;
  Series line;
  for (int i = 0; i < 100'000; ++i) {
    line.points.push_back({static_cast<double>(i), i == 54'321 ? 10.0 : 1.0});
  }
  plot.series = {line};
  const std::string svg = plot_svg(plot, {400, 200});
  EXPECT_LT(svg.size(), 40'000U);
  EXPECT_NE(svg.find(" 8.0L"), std::string::npos) << "the value 10 is at the top of the frame, 8 units below 0";
}

TEST(Plots, AnEmptyPlotIsAFrameWithoutNaN) {
  const std::string svg = plot_svg({}, {400, 200});
  EXPECT_NE(svg.find("<svg"), std::string::npos);
  EXPECT_EQ(svg.find("inf"), std::string::npos) << svg;
  EXPECT_EQ(svg.find("nan"), std::string::npos) << svg;
}

TEST(Page, Base64IsThatOfTheStandard) { // [RFC 4648, section 10]
  const auto of = [](std::string_view text) { return base64({text.begin(), text.end()}); };
  EXPECT_EQ(of(""), "");
  EXPECT_EQ(of("f"), "Zg==");
  EXPECT_EQ(of("fo"), "Zm8=");
  EXPECT_EQ(of("foo"), "Zm9v");
  EXPECT_EQ(of("foobar"), "Zm9vYmFy");
}

SessionAnalysis some_session() {
  SessionAnalysis session;
  session.start_ns = 1'700'000'000'000'000'000;
  session.end_ns = session.start_ns + 20'000'000'000;
  session.meta = {{"case", "<colin & 27>"}};
  session.tools = {"Probe", "Stylus"};
  session.has_truth = true;
  for (int i = 0; i < 1000; ++i) {
    TipSample tip;
    tip.time_ns = session.start_ns + i * 20'000'000LL;
    tip.tool = i < 500 ? 1 : 0;
    tip.predicted_rms_mm = 0.8;
    tip.true_error_mm = 0.5 + 0.2 * std::sin(i * 0.1);
    tip.ellipsoid = 0.3;
    tip.at_target = i > 900;
    session.tips.push_back(tip);
  }
  session.sent_to_published_ms = distribution_of({0.1, 0.2, 0.2, 0.3, 5.0});
  session.states = {{session.start_ns, session.start_ns + 10'000'000'000, "registering"},
                    {session.start_ns + 10'000'000'000, session.end_ns, "navigating"}};
  session.alarms = {{session.start_ns + 3'000'000'000, "drift", "<script>", "raised", "critical", "moved & more"}};
  session.registration = RegistrationSummary{};
  session.registration->fre_mm = 0.52;
  for (const auto &v : {Eigen::Vector3d(0, 0, 0), {100, 0, 0}, {0, 100, 0}, {0, 0, 100}}) {
    session.scalp.vertices_mm.push_back(v);
  }
  session.scalp.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  session.trace = {{{30, 30, 40}, 0.5}, {{40, 30, 30}, -0.7}};
  return session;
}

TEST(Page, IsOneFileThatLoadsNothing) {
  const auto page = html_report(some_session(), {});
  ASSERT_TRUE(page.has_value()) << page.error().message;
  for (const char *loads : {"<script", "<link", "@import", "url(http", "src='http", "href="}) {
    EXPECT_EQ(page->find(loads), std::string::npos) << loads;
  }
  EXPECT_EQ(count_of(*page, "src='data:image/png;base64,iVBOR"), 4U) << "four views of the head";
  EXPECT_GE(count_of(*page, "<svg"), 8U);
  EXPECT_NE(page->find("width=device-width"), std::string::npos);
}

TEST(Page, TheInsertionIsDrawnAgainstDepthWithoutItsInvalidAnswers) {
  SessionAnalysis session = some_session();
  EXPECT_EQ(tissue_force_figure(session) + tissue_stress_figure(session) + tissue_motion_figure(session), "");
  InsertionAnalysis insertion;
  insertion.target = "Deep";
  insertion.rupture_depth_mm = 4.0;
  insertion.states = {{"valid", 49}, {"invalid", 1}};
  for (int k = 0; k < 50; ++k) {
    insertion.samples.push_back({k, k < 20 ? "indentation" : "penetration", k == 30 ? "invalid" : "valid", 0.2 * k,
                                 0.01 * k, 0.001 * k, 0.011 * k, 2.0 * k, 0.01 * k, 0.02});
  }
  session.insertion = insertion;
  const std::string motion = tissue_motion_figure(session);
  EXPECT_NE(motion.find("rupture"), std::string::npos);
  const auto path = motion.substr(motion.find("<path d='"));
  EXPECT_EQ(count_of(path.substr(0, path.find("fill")), "M"), 2U) << "the line is broken at the invalid answer";
  const auto page = html_report(session, {});
  ASSERT_TRUE(page.has_value());
  EXPECT_NE(page->find("The brain under the probe"), std::string::npos);
  EXPECT_NE(page->find("Force against depth"), std::string::npos);
  EXPECT_NE(page->find("<td class=''>invalid</td><td class='n '>1</td>"), std::string::npos);
  EXPECT_EQ(page->find(">nan"), std::string::npos);
}

TEST(Page, WhereTheProbeStandsStillTheCourseIsDrawnAgainstTime) {
  SessionAnalysis session = some_session();
  InsertionAnalysis insertion;
  for (int k = 0; k < 50; ++k) {
    insertion.samples.push_back({session.start_ns + k * 100'000'000LL, "penetration", "valid", 0.2 * std::min(k, 30),
                                 0.01, 0.001, 0.011, 2.0, 0.01, 0.02, k >= 30});
  }
  session.insertion = insertion;
  const std::string depth = tissue_motion_figure(session);
  const std::string time = tissue_still_figure(session);
  EXPECT_NE(time.find("Motion of the target over time, where the probe stands still"), std::string::npos);
  EXPECT_NE(time.find("time, s"), std::string::npos);
  EXPECT_NE(depth.find("depth in the tissue, mm"), std::string::npos);
  for (TissueSample &sample : session.insertion->samples) {
    sample.still = false;
  }
  EXPECT_EQ(tissue_still_figure(session), "");
}

TEST(Page, ThePathIsDrawnAlongThePlanAndOnTheHead) {
  SessionAnalysis session = some_session();
  EXPECT_EQ(path_figure(session) + deviation_figure(session) + path_on_head_figure(session).value(), "");
  for (int k = 0; k < 100; ++k) {
    const double before_mm = 50.0 - 0.5 * k;
    session.path.push_back(
        {session.start_ns + k * 4'000'000LL, "<b>iopsy", {30.0 + 0.4, 30.0, 10.0 + before_mm}, before_mm, 0.4});
  }
  EXPECT_NE(path_figure(session).find("lateral deviation"), std::string::npos) << "its directions are not known";
  EXPECT_EQ(path_on_head_figure(session).value(), "");
  session.plans = {{"<b>iopsy", {30, 30, 60}, {30, 30, 10}}};
  const std::string path = path_figure(session);
  EXPECT_NE(path.find("towards right"), std::string::npos);
  EXPECT_NE(path.find("towards anterior"), std::string::npos);
  EXPECT_NE(path.find("entry"), std::string::npos);
  const std::string head = path_on_head_figure(session).value();
  EXPECT_EQ(count_of(head, "src='data:image/png;base64,iVBOR"), 2U);
  const auto page = html_report(session, {});
  ASSERT_TRUE(page.has_value());
  EXPECT_NE(page->find("The path along the plan"), std::string::npos);
  EXPECT_EQ(page->find("<b>iopsy"), std::string::npos);
}

TEST(Page, TheSeedOfASimulatedRunIsStatedWhereItIsKnown) {
  SessionAnalysis session = some_session();
  EXPECT_NE(html_report(session, {})->find("simulated, so the truth is known"), std::string::npos);
  session.seed = 20260901;
  EXPECT_NE(html_report(session, {})->find("simulated with seed 20260901, so the truth is known"), std::string::npos);
}

TEST(Page, VersionAndPivotsAreStated) {
  SessionAnalysis session = some_session();
  EXPECT_NE(html_report(session, {})->find("version not known"), std::string::npos);
  EXPECT_NE(html_report(session, {})->find("No tool was calibrated in this session"), std::string::npos);
  session.meta.push_back({"version", "1.2.3"});
  session.meta.push_back({"build", "abc-dirty"});
  session.pivots = {{session.start_ns, "Stylus", true, 0.21, "Stylus: tip known to 0.05 mm"}};
  const auto page = html_report(session, {});
  ASSERT_TRUE(page.has_value());
  EXPECT_NE(page->find("bregmad 1.2.3 (abc-dirty)"), std::string::npos);
  EXPECT_NE(page->find("Stylus: tip known to 0.05 mm"), std::string::npos);
}

TEST(Page, AHeadThatCannotBeDrawnIsSaidToBeMissing) {
  auto session = some_session();
  session.registration->surface_points = 300;
  EXPECT_EQ(html_report(session, {})->find("holds no scalp"), std::string::npos);
  session.scalp = {};
  session.trace.clear();
  EXPECT_NE(html_report(session, {})->find("holds no scalp"), std::string::npos);
}

TEST(Page, NamesFromTheFileCannotBecomeMarkup) {
  const auto page = html_report(some_session(), {});
  ASSERT_TRUE(page.has_value());
  EXPECT_NE(page->find("&lt;colin &amp; 27&gt;"), std::string::npos);
  EXPECT_NE(page->find("&lt;script&gt;"), std::string::npos);
  EXPECT_NE(page->find("moved &amp; more"), std::string::npos);
}

TEST(Page, EveryFigureOfConsistencySaysThatItIsNotAnAccuracy) {
  const auto page = html_report(some_session(), {});
  ASSERT_TRUE(page.has_value());
  const auto at = page->find("0.52 mm");
  ASSERT_NE(at, std::string::npos);
  EXPECT_NE(page->substr(at, 120).find("not an accuracy"), std::string::npos);
}

TEST(Page, SessionWithoutAnythingIsStillAPage) {
  SessionAnalysis session;
  session.start_ns = 1'700'000'000'000'000'000;
  session.end_ns = session.start_ns;
  const auto page = html_report(session, {});
  ASSERT_TRUE(page.has_value());
  EXPECT_NE(page->find("not known"), std::string::npos);
  EXPECT_EQ(page->find("nan"), std::string::npos);
}

TEST(Page, BrokenLimitsAreCountedOnTop) {
  Judgement good{"max_fre_mm", "fre", 0.5, 1.0, "mm", true, true};
  Judgement broken{"max_check_mm", "check", bregma::geometry::kUnknown, 1.0, "mm", true, false};
  const auto page = html_report(some_session(), {good, broken});
  ASSERT_TRUE(page.has_value());
  EXPECT_NE(page->find("1 of 2 limits exceeded"), std::string::npos);
}

std::string page_of(const SessionAnalysis &session) { return html_report(session, {}).value(); }

TEST(ReportPageContent, ACaseWithoutStructuresIsNotCalledNoneApproached) {
  SessionAnalysis session;
  EXPECT_NE(page_of(session).find("none was approached while navigating"), std::string::npos);
  session.structures = 0;
  EXPECT_NE(page_of(session).find("this case has no structures"), std::string::npos);
}

TEST(ReportPageContent, TheAcceptedRegistrationIsShownAsAMatrix) {
  SessionAnalysis session;
  session.registration.emplace();
  EXPECT_EQ(page_of(session).find("From Reference to Image"), std::string::npos) << "its pose is not known";
  session.registration->T_image_reference = Eigen::Matrix4d::Identity();
  session.registration->T_image_reference(0, 3) = 12.3456;
  const std::string page = page_of(session);
  EXPECT_NE(page.find("From Reference to Image (RAS, mm)"), std::string::npos);
  EXPECT_NE(page.find("12.346"), std::string::npos);
}

} // namespace
