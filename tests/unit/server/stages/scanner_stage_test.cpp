// The procedure that registers the robot to a scanner, and the correction of slices, in virtual time: the real stage
// with a fake scanner, coil controller and registration frame.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "server/stages/wire_values.hpp"
#include "tests/unit/server/stages/fake_scanner.hpp"

namespace bregma::server::testing {
namespace {

int count_of(const wire::ScannerRegistration &state, wire::CoilOutcome outcome) {
  int out = 0;
  for (std::uint32_t i = 0; i < state.coil_count; ++i) {
    out += state.coils[i].outcome == outcome ? 1 : 0;
  }
  return out;
}

bool says(const char *text, const std::string &words) { return std::string(text).find(words) != std::string::npos; }

void expect_failed(ScannerBench &bench, wire::ScannerStep step, const std::string &words) {
  EXPECT_EQ(bench.state.step, step);
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED) << bench.state.text;
  EXPECT_TRUE(says(bench.state.text, words)) << bench.state.text;
  EXPECT_FALSE(std::string(bench.state.next).empty());
  EXPECT_FALSE(bench.scanner.coils_on()) << "the coils are switched off";
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_REFUSED);
  EXPECT_FALSE(bench.stage->pose.load()->valid);
}

void accept(ScannerBench &bench) {
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
}

TEST(ScannerProcedure, GuidesFromTheScoutToAnAcceptedRegistration) {
  ScannerBench bench;
  EXPECT_TRUE(says(bench.confirm("swap").text, "start the registration of the scanner first"));
  bench.procedure();
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
  EXPECT_EQ(bench.state.verdict, bregma_wire_SCANNER_VERDICT_FOUND);
  const std::vector<std::string> patterns = {"background", "top",        "background", "background", "bottom",
                                             "background", "background", "tree",       "background"};
  EXPECT_EQ(bench.scanner.patterns, patterns);
  const std::vector<std::string> protocols = {"scout", "top", "top", "bottom", "bottom", "tree", "tree"};
  EXPECT_EQ(bench.scanner.protocols, protocols);
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_USED), 8);
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_VERIFIES), 3);
  EXPECT_LT(bench.target_error_mm(bench.state.T_base_scanner), 0.3);
  EXPECT_LT(bench.state.fre_mm, 0.5);
  EXPECT_LT(bench.state.verified_mm, 0.6);
  EXPECT_GT(bench.state.tre_95_mm, bench.target_error_mm(bench.state.T_base_scanner));
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALIDITY_NONE);
  EXPECT_FALSE(bench.stage->pose.load()->valid);

  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.step();
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_DONE);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID);
  EXPECT_LT(bench.target_error_mm(bench.stage->pose.load()->T_base_scanner), 0.3);
  EXPECT_TRUE(bench.alarms.empty());

  // Registering again, after the frame moved by a millimetre, shows the change; the accepted one stays until then.
  const wire::Pose accepted = bench.state.accepted_T_base_scanner;
  bench.scanner.frame_moved_mm = {0.0, 1.0, 0.0};
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
  EXPECT_NEAR(bench.state.change_mm, 1.0, 0.25);
  EXPECT_EQ(bench.state.accepted_T_base_scanner.translation_mm[1], accepted.translation_mm[1]);
}

TEST(ScannerProcedure, AFrameThatMovedIsFoundByTheCoilsThatVerify) {
  ScannerBench bench;
  bench.procedure();
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.scanner.frame_moved_mm = {0.0, 0.0, 4.0};
  EXPECT_EQ(bench.confirm("verify").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_FRAME_MOVED) << bench.state.text;
  EXPECT_TRUE(std::isnan(bench.state.accepted_T_base_scanner.translation_mm[0]));
  EXPECT_FALSE(bench.stage->pose.load()->valid);
  EXPECT_TRUE(bench.alarms.contains("scanner_moved"));
}

TEST(ScannerProcedure, ATableThatMovedVoidsTheRegistrationForGood) {
  ScannerBench bench;
  bench.procedure();
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.scanner.table_mm = 12.0;
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_TABLE_MOVED);
  EXPECT_TRUE(says(bench.state.validity_text, "the table moved by 12.00 mm")) << bench.state.validity_text;
  EXPECT_FALSE(bench.stage->pose.load()->valid);
  EXPECT_TRUE(bench.alarms.contains("scanner_moved"));
  bench.scanner.table_mm = 0.0;
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_TABLE_MOVED);
}

TEST(ScannerProcedure, CoilsThatAreLostAreReportedAndTooManyRefuse) {
  ScannerBench bench;
  bench.scanner.dark = {1};
  bench.procedure();
  EXPECT_EQ(bench.state.verdict, bregma_wire_SCANNER_VERDICT_FOUND) << bench.state.text;
  EXPECT_EQ(bench.state.coils[1].outcome, bregma_wire_COIL_NOT_SEEN);
  EXPECT_TRUE(says(bench.state.reason, "t2 is missing")) << bench.state.reason;
  EXPECT_LT(bench.target_error_mm(bench.state.T_base_scanner), 0.4);

  ScannerBench worse;
  worse.scanner.dark = {0, 1, 4, 5, 6};
  worse.procedure();
  EXPECT_NE(worse.state.verdict, bregma_wire_SCANNER_VERDICT_FOUND);
  expect_failed(worse, bregma_wire_SCANNER_STEP_BOTTOM, "refused");
}

TEST(ScannerProcedure, SwappedCablesNeverRegister) {
  ScannerBench bench;
  bench.scanner.cables = {{"top", "bottom"}, {"bottom", "top"}};
  bench.procedure();
  EXPECT_NE(bench.state.verdict, bregma_wire_SCANNER_VERDICT_FOUND);
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED);
  EXPECT_FALSE(bench.stage->pose.load()->valid);
}

// The cables of t4 and b1 are exchanged: each lights up in the other's scan.
TEST(ScannerProcedure, OneSwappedPairOfCablesIsReportedAndTheRestRegisters) {
  ScannerBench bench;
  bench.scanner.cables = {{"top", "t1+t2+t3+b1"}, {"bottom", "t4+b2+b3+b4"}};
  bench.procedure();
  ASSERT_EQ(bench.state.verdict, bregma_wire_SCANNER_VERDICT_FOUND) << bench.state.text;
  EXPECT_LT(bench.target_error_mm(bench.state.T_base_scanner), 0.5);
  const auto coil = [&](const std::string &name) {
    for (std::uint32_t i = 0; i < bench.state.coil_count; ++i) {
      if (wire::view(bench.state.coils[i].coil) == name) {
        return bench.state.coils[i].outcome;
      }
    }
    return bregma_wire_COIL_OUTCOME_UNKNOWN;
  };
  EXPECT_NE(coil("t4"), bregma_wire_COIL_USED);
  EXPECT_NE(coil("b1"), bregma_wire_COIL_USED);
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_USED), 6);
  EXPECT_FALSE(std::string(bench.state.reason).empty());
}

// The scan of the bottom shows the coils that verify: the top alone registers, and the rest is reported.
TEST(ScannerProcedure, AScanOfOtherCoilsThanOrderedNeverRegistersWrongly) {
  ScannerBench bench;
  bench.scanner.cables = {{"bottom", "tree"}};
  bench.procedure();
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_USED), 4);
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_NOT_SEEN), 4);
  EXPECT_FALSE(std::string(bench.state.reason).empty());
  EXPECT_LT(bench.target_error_mm(bench.state.T_base_scanner), bench.state.tre_95_mm);
  EXPECT_LT(bench.state.tre_95_mm, 3.0);
}

TEST(ScannerProcedure, ASaturatedScanIsRefused) {
  ScannerBench bench;
  bench.scanner.saturation = 1000.0;
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "saturated");
}

TEST(ScannerProcedure, AnotherSeriesThanTheOrderedOneIsNotUsed) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) == "top") {
      (void)wire::set_name(slice.protocol, "other");
    }
  };
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  bool said = false;
  for (int i = 0; i < 200 && bench.state.activity != bregma_wire_SCANNER_FAILED; ++i) {
    bench.step();
    said = said || says(bench.state.text, "is \"other\", not \"top\": it is not used");
  }
  EXPECT_TRUE(said);
  bench.step();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "has not answered");
}

TEST(ScannerProcedure, MixedOrientationsEndTheStep) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) == "bottom" && slice.index == 30) {
      const double h = std::sqrt(0.5);
      slice.T_scanner_slice = {{h, h, 0, 0}, {-95, 0, -95}};
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_BOTTOM, "mixed orientations");
  EXPECT_EQ(bench.state.slices_refused, 1U);
  EXPECT_TRUE(bench.alarms.contains("slices_refused"));
}

TEST(ScannerProcedure, AForegroundInAnotherPlaneThanItsBackgroundIsRefused) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (slice.coil_state == bregma_wire_COILS_POSITIVE) {
      slice.T_scanner_slice.translation_mm[2] += 4.5;
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "4.50 mm from that of the background");
}

TEST(ScannerProcedure, ImagesThatTheVendorHasCorrectedAreRefused) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) { slice.correction = bregma_wire_CORRECTION_VENDOR_3D; };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "corrected by the vendor already");
}

TEST(ScannerProcedure, ATableThatMovesBetweenBackgroundAndForegroundIsNoticed) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    slice.table_mm = slice.coil_state == bregma_wire_COILS_POSITIVE ? 3.0 : 0.0;
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "the table moved");
}

TEST(ScannerProcedure, AControllerThatRefusesOrIsSilentEndsTheStep) {
  ScannerBench bench;
  bench.scanner.refuse_coils = "top";
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "Coils: t2 has no current");

  // One that does not answer "off" either: an alarm, as coils may carry current.
  ScannerBench silent;
  EXPECT_EQ(silent.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(silent.settle());
  silent.scanner.answers = false;
  EXPECT_EQ(silent.confirm("top").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(silent.settle());
  EXPECT_TRUE(says(silent.state.text, "Coils has not answered")) << silent.state.text;
  for (int i = 0; i < 220; ++i) {
    silent.step();
  }
  EXPECT_TRUE(silent.alarms.contains("coils_on"));
}

TEST(ScannerProcedure, SlicesThatStopComingEndTheStep) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) == "top" && slice.index > 40) {
      (void)wire::set_name(slice.device, "Elsewhere");
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "40 of 60 slices came, then no more");
}

TEST(ScannerProcedure, AResetSwitchesTheCoilsOffAndForgetsTheRegistration) {
  ScannerBench bench;
  bench.procedure();
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  while (!bench.scanner.coils_on()) {
    bench.step();
  }
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.step();
  EXPECT_FALSE(bench.scanner.coils_on());
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_IDLE);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALIDITY_NONE);
}

// With the phantom: the field is measured, coils and later slices are corrected by it, and it expires.
TEST(ScannerProcedure, TheMeasuredFieldCorrectsCoilsAndLaterSlices) {
  ScannerBench bench(true);
  bench.scanner.distorts = true;
  bench.procedure();
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
  EXPECT_EQ(bench.state.field_status, bregma_wire_FIELD_VALID);
  EXPECT_GE(bench.state.field_points, 115U);
  EXPECT_GT(bench.state.field_initial_mm, 0.4);
  EXPECT_LT(bench.state.field_residual_mm, 0.3);
  EXPECT_LT(bench.state.phantom_moved_mm, 0.15);
  EXPECT_LT(bench.target_error_mm(bench.state.T_base_scanner), 0.5);
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.step();
  EXPECT_TRUE(bench.state.accepted_corrected);

  // A tool whose tip is 2 mm in front of the plane of the live slice.
  RobotToolsView tools;
  tools.count = 1;
  wire::RobotTool &tool = tools.tools[0];
  (void)wire::set_name(tool.tool, "Guide");
  tool.status = tool.scanner_status = bregma_wire_POSE_LIVE;
  tool.published_time_ns = bench.now.utc_ns;
  tool.valid_for_ns = 10 * kTick_ns;
  tool.T_scanner_tip = {{1, 0, 0, 0}, {15.0 - 95.25, 30.0 - 95.25, 2.0}};
  tool.scanner_error_95_mm = 0.7;
  bench.tools.store(tools);
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  ASSERT_EQ(bench.corrected.size(), 1U) << bench.state.refused_text;
  const wire::CorrectedSlice &slice = bench.corrected.back();
  EXPECT_EQ(slice.slice.correction, bregma_wire_CORRECTION_BREGMA_2D) << "it came alone";
  EXPECT_GT(slice.max_shift_mm, 0.5);
  EXPECT_EQ(slice.tip_status, bregma_wire_POSE_LIVE);
  EXPECT_NEAR(slice.tip_pixel[0], 10.0, 1e-6);
  EXPECT_NEAR(slice.tip_pixel[1], 20.0, 1e-6);
  EXPECT_NEAR(slice.tip_distance_mm, 2.0, 1e-6);
  EXPECT_NEAR(slice.tip_direction[2], 1.0, 1e-9);
  EXPECT_EQ(bench.corrected_pixels.size(), 128U * 128U);
  EXPECT_EQ(bench.state.slices_corrected, 1U);

  // Slices of a series are corrected as they come, and once more when their neighbours have come.
  bench.corrected.clear();
  bench.scanner.send_live("live", 24, bench.now.utc_ns);
  for (int i = 0; i < 40; ++i) {
    bench.step();
  }
  std::map<std::uint32_t, std::vector<wire::CorrectedSlice>> of_index;
  for (const wire::CorrectedSlice &one : bench.corrected) {
    of_index[one.slice.index].push_back(one);
  }
  EXPECT_EQ(of_index.size(), 24U);
  EXPECT_EQ(bench.state.slices_corrected, 1U + bench.corrected.size());
  int again = 0;
  for (const auto &[index, published] : of_index) {
    ASSERT_LE(published.size(), 2U) << index;
    again += published.size() == 2 ? 1 : 0;
    EXPECT_LE(published.back().missing_fraction, published.front().missing_fraction) << index;
  }
  EXPECT_GE(again, 12);
  EXPECT_GT(of_index[12].front().missing_fraction, 0.01);
  EXPECT_EQ(of_index[12].front().slice.correction, bregma_wire_CORRECTION_BREGMA_2D);
  EXPECT_EQ(of_index[12].back().slice.correction, bregma_wire_CORRECTION_BREGMA_3D);
  bench.corrected.resize(1);

  bench.scanner.change = [](wire::ImageSlice &one) { one.correction = bregma_wire_CORRECTION_VENDOR_2D; };
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  for (int i = 0; i < 25; ++i) {
    bench.step();
  }
  EXPECT_EQ(bench.corrected.size(), 1U) << "never corrected twice";
  EXPECT_TRUE(says(bench.state.refused_text, "corrected already")) << bench.state.refused_text;

  // A verification adds to the stated error what the coils show and their stated errors do not explain.
  bench.scanner.change = [](wire::ImageSlice &) {};
  const double stated = bench.state.accepted_tre_95_mm;
  EXPECT_EQ(bench.confirm("verify").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID) << bench.state.text;
  EXPECT_NEAR(bench.state.accepted_tre_95_mm, stated, 0.3);
  bench.let_pass(91LL * 24 * 3600 * 1'000'000'000);
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  EXPECT_EQ(bench.corrected.size(), 1U);
  EXPECT_EQ(bench.state.field_status, bregma_wire_FIELD_EXPIRED);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_FIELD_EXPIRED);
}

// B0 displaces by up to 1.5 mm, and changes by 40 Hz after it was mapped.
TEST(ScannerProcedure, OpposedReadOutsRegisterWhateverB0Is) {
  ScannerBench bench(true, true);
  bench.scanner.distorts = true;
  double entered_Hz = 0.0;
  bench.scanner.b0_Hz = [&](const Eigen::Vector3d &p) { return 40.0 + p.z() + entered_Hz; };
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_SWAP) << bench.state.text;
  EXPECT_GE(bench.state.field_points, 110U);
  EXPECT_LT(bench.state.field_residual_mm, 0.3);
  entered_Hz = 40.0;
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
  const std::vector<std::string> protocols = {
      "scout",           "phantom", "phantom-reversed", "phantom", "scout",           "top",
      "top-reversed",    "top",     "top-reversed",     "bottom",  "bottom-reversed", "bottom",
      "bottom-reversed", "tree",    "tree-reversed",    "tree",    "tree-reversed"};
  EXPECT_EQ(bench.scanner.protocols, protocols);
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_USED), 8);
  EXPECT_EQ(count_of(bench.state, bregma_wire_COIL_VERIFIES), 3);
  EXPECT_LT(bench.target_error_mm(bench.state.T_base_scanner), 0.4);
  // 40 Hz are 0.6 mm of these images, which the stated error contains.
  EXPECT_TRUE(says(bench.state.text, "B0 has changed by up to 0.6")) << bench.state.text;
  EXPECT_GT(bench.state.tre_95_mm, 1.0);
  accept(bench);

  // Slices are corrected by B0 of their own read-out, as it was mapped.
  entered_Hz = 0.0;
  bench.scanner.send_live("live", 24, bench.now.utc_ns);
  for (int i = 0; i < 20; ++i) {
    bench.step();
  }
  ASSERT_FALSE(bench.corrected.empty()) << bench.state.refused_text;
  EXPECT_GT(bench.corrected.back().max_shift_mm, 1.0);

  // A daemon that is started again reads both parts, and needs no phantom.
  const auto read = load_field(bench.folder.path() / "field.nrrd");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(read->scans->has_b0());
  EXPECT_NEAR(read->scans->b0_Hz(Eigen::Vector3d::Zero()), 40.0, 4.0);
}

TEST(ScannerProcedure, ReadOutsThatAreNotOpposedAsOrderedAreRefused) {
  for (const char *protocol : {"phantom-reversed", "top-reversed"}) {
    ScannerBench bench(true, true);
    bench.scanner.b0_Hz = [](const Eigen::Vector3d &) { return 0.0; };
    bench.scanner.change = [&](wire::ImageSlice &slice) {
      if (wire::view(slice.protocol) == protocol) {
        slice.read_out = bregma_wire_DIRECTION_ROW_POSITIVE;
      }
    };
    bench.procedure();
    EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED);
    EXPECT_TRUE(says(bench.state.text, "does not state opposed read-outs")) << bench.state.text;
    EXPECT_FALSE(bench.scanner.coils_on());
  }
}

// A field of one read-out, and scans with the opposite one: B0 would be doubled.
TEST(ScannerProcedure, AFieldOfTheOppositeReadOutIsNotUsed) {
  ScannerBench bench(true);
  bench.scanner.b0_Hz = [](const Eigen::Vector3d &) { return 60.0; };
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) != "phantom") {
      slice.read_out = bregma_wire_DIRECTION_ROW_NEGATIVE;
    }
  };
  bench.procedure();
  EXPECT_EQ(bench.state.verdict, bregma_wire_SCANNER_VERDICT_REFUSED);
  expect_failed(bench, bregma_wire_SCANNER_STEP_BOTTOM, "measured with the opposite read-out");
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  for (int i = 0; i < 25; ++i) {
    bench.step();
  }
  EXPECT_TRUE(bench.corrected.empty());
  EXPECT_TRUE(says(bench.state.refused_text, "measured with the opposite read-out")) << bench.state.refused_text;
}

TEST(ScannerProcedure, AVerificationWithTheOppositeReadOutSaysNothingAboutTheRegistration) {
  ScannerBench bench(true);
  bench.scanner.b0_Hz = [](const Eigen::Vector3d &) { return 60.0; };
  bench.procedure();
  accept(bench);
  bench.scanner.change = [](wire::ImageSlice &slice) { slice.read_out = bregma_wire_DIRECTION_ROW_NEGATIVE; };
  EXPECT_EQ(bench.confirm("verify").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED);
  EXPECT_TRUE(says(bench.state.text, "measured with the opposite read-out")) << bench.state.text;
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID);
}

TEST(ScannerProcedure, AForegroundWithAnotherReadOutThanItsBackgroundIsRefused) {
  ScannerBench bench;
  bench.scanner.b0_Hz = [](const Eigen::Vector3d &) { return 0.0; };
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (slice.coil_state != bregma_wire_COILS_OFF) {
      slice.read_out = bregma_wire_DIRECTION_ROW_NEGATIVE;
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "another read-out or bandwidth than the background");
}

TEST(ScannerProcedure, AFieldWhoseMeasurementWasResetIsNotSaved) {
  ScannerBench bench(true);
  bench.host.later = true;
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  while (bench.host.jobs.empty()) {
    bench.step();
    ASSERT_NE(bench.state.activity, bregma_wire_SCANNER_FAILED) << bench.state.text;
  }
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.host.jobs.front()();
  bench.step();
  EXPECT_EQ(bench.state.field_status, bregma_wire_FIELD_NONE);
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_IDLE);
  EXPECT_FALSE(std::filesystem::exists(bench.folder.path() / "field.nrrd"));
}

TEST(ScannerProcedure, AFieldThatExpiresByTheWallClockIsNotUsed) {
  ScannerBench bench(true);
  bench.procedure();
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
  constexpr std::int64_t kStep_ns = 91LL * 24 * 3600 * 1'000'000'000;
  bench.now.wall_minus_boot_ns = kStep_ns;
  const StageAnswer refused = bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"});
  EXPECT_EQ(refused.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_TRUE(says(refused.text, "the distortion field has expired since the scans")) << refused.text;
  EXPECT_EQ(bench.state.field_status, bregma_wire_FIELD_EXPIRED);
  bench.now.wall_minus_boot_ns = 0;
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID);
  bench.now.wall_minus_boot_ns = kStep_ns;
  bench.step();
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_FIELD_EXPIRED);
  EXPECT_FALSE(bench.stage->pose.load()->valid);
}

// The slice that shows that the table moved is not shown with a tip of the registration that it voids.
TEST(ScannerProcedure, TheSliceThatVoidsTheRegistrationHasNoTip) {
  ScannerBench bench(true);
  bench.procedure();
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  RobotToolsView tools;
  tools.count = 1;
  wire::RobotTool &tool = tools.tools[0];
  tool.status = tool.scanner_status = bregma_wire_POSE_LIVE;
  tool.published_time_ns = bench.now.utc_ns;
  tool.valid_for_ns = 10 * kTick_ns;
  tool.T_scanner_tip = {{1, 0, 0, 0}, {0, 0, 0}};
  bench.tools.store(tools);
  bench.scanner.table_mm = 12.0;
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  ASSERT_EQ(bench.corrected.size(), 1U);
  EXPECT_EQ(bench.corrected.back().tip_status, bregma_wire_POSE_NOT_REGISTERED);
  EXPECT_TRUE(std::isnan(bench.corrected.back().tip_pixel[0]));
}

TEST(ScannerProcedure, APhantomThatMovedDuringItsScansRefusesTheField) {
  ScannerBench bench(true);
  int phantoms = 0;
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) == "phantom" && slice.index == 1 && ++phantoms == 1) {
      bench.scanner.phantom_moved_mm = {0.0, 1.0, 0.0}; // before its second scan
    }
  };
  bench.procedure();
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_PHANTOM);
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED);
  EXPECT_TRUE(says(bench.state.text, "the phantom moved by")) << bench.state.text;
  EXPECT_EQ(bench.state.field_status, bregma_wire_FIELD_NONE);
}

// ---- steps in a wrong order ----

void expect_refused(const StageAnswer &answer, const std::string &words) {
  EXPECT_EQ(answer.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_TRUE(says(answer.text, words)) << answer.text;
}

TEST(ScannerProcedure, CoilsVerifyTheAcceptedRegistrationAndNoEstimateThatFailed) {
  ScannerBench bench;
  bench.procedure();
  accept(bench);
  const std::uint32_t accepted = bench.state.accepted_revision;
  bench.scanner.dark = {0, 1, 2, 4, 5};
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  ASSERT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED) << bench.state.text;
  ASSERT_NE(bench.state.verdict, bregma_wire_SCANNER_VERDICT_FOUND);
  EXPECT_EQ(bench.confirm("verify").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_DONE) << bench.state.text;
  expect_refused(bench.command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}), "nothing to accept");
  EXPECT_EQ(bench.state.accepted_revision, std::max(accepted, 1U));
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID);
}

TEST(ScannerProcedure, AnEstimateThatDoesNotVerifyIsNotShownAsFound) {
  ScannerBench bench;
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) == "bottom" && slice.coil_state == bregma_wire_COILS_POSITIVE) {
      bench.scanner.frame_moved_mm = {0.0, 0.0, 4.0}; // before the coils that verify are scanned
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_VERIFY, "from where the registration expects them");
  EXPECT_EQ(bench.state.verdict, bregma_wire_SCANNER_VERDICT_INCONSISTENT);
  EXPECT_TRUE(std::isnan(bench.state.T_base_scanner.translation_mm[0]));
  EXPECT_EQ(std::string(bench.state.reason), bench.state.text);
  expect_refused(bench.confirm("verify"), "nothing is registered yet");
}

TEST(ScannerProcedure, AVoidRegistrationIsNotVerified) {
  ScannerBench bench;
  bench.procedure();
  accept(bench);
  bench.scanner.table_mm = 12.0;
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  expect_refused(bench.confirm("verify"), "the registration is void, the table moved by 12.00 mm");
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_DONE);
}

TEST(ScannerProcedure, ARegistrationThatIsVoidedWhileItIsVerifiedIsNotVerified) {
  ScannerBench bench;
  bench.procedure();
  accept(bench);
  EXPECT_EQ(bench.confirm("verify").result, bregma_wire_COMMAND_DONE);
  bench.scanner.change = [](wire::ImageSlice &slice) {
    slice.table_mm = wire::view(slice.protocol) == "live" ? 12.0 : 0.0;
  };
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED) << bench.state.text;
  EXPECT_TRUE(says(bench.state.text, "the registration is void, the table moved by")) << bench.state.text;
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_TABLE_MOVED);
}

TEST(ScannerProcedure, ATableThatMovesWithinASeriesEndsTheStep) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    slice.table_mm = slice.index > 30 && slice.coil_state == bregma_wire_COILS_OFF ? 12.0 : 0.0;
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "the table moved within series");
}

TEST(ScannerProcedure, ATableThatMovesBeforeTheOperatorAcceptsIsNoticed) {
  ScannerBench bench;
  bench.procedure();
  ASSERT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT);
  bench.scanner.table_mm = 12.0;
  bench.scanner.send_live("live", 1, bench.now.utc_ns);
  bench.step();
  bench.step();
  expect_failed(bench, bregma_wire_SCANNER_STEP_ACCEPT, "the table moved by 12.00 mm since the scans");
  EXPECT_EQ(bench.state.verdict, bregma_wire_SCANNER_VERDICT_INCONSISTENT);
  expect_refused(bench.confirm("verify"), "nothing is registered yet");
}

TEST(ScannerProcedure, ScansOfBeforeTheFrameWasPlacedAreForgotten) {
  ScannerBench bench;
  bench.procedure();
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  bench.scanner.frame_moved_mm = {0.0, 2.0, 0.0};
  expect_refused(bench.confirm("bottom"), "the top is not scanned");
  expect_refused(bench.confirm("verify"), "nothing is registered yet");
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
}

TEST(ScannerProcedure, AFrameThatWasPlacedAnewVoidsTheRegistration) {
  ScannerBench bench;
  bench.procedure();
  accept(bench);
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID) << "nothing was moved yet";
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_FRAME_MOVED);
  EXPECT_FALSE(bench.stage->pose.load()->valid);
  EXPECT_TRUE(bench.alarms.contains("scanner_moved"));
  ASSERT_TRUE(bench.settle());
  EXPECT_LT(bench.state.change_mm, 0.3) << "against the one that is void";
  accept(bench);
  bench.step();
  EXPECT_EQ(bench.state.validity, bregma_wire_SCANNER_VALID);
  EXPECT_TRUE(bench.alarms.empty());
}

// As scanners do: all odd slices first, then the even ones backwards.
TEST(ScannerProcedure, SlicesInAnyOrderGiveTheSameRegistration) {
  ScannerBench in_order, mixed;
  mixed.scanner.change = [](wire::ImageSlice &slice) {
    const std::uint32_t odd = (slice.count + 1) / 2, n = slice.index;
    const std::uint32_t index = n <= odd ? 2 * n - 1 : 2 * (slice.count - n + 1);
    const auto moved = static_cast<std::ptrdiff_t>(index) - static_cast<std::ptrdiff_t>(n);
    slice.pixels._buffer += moved * static_cast<std::ptrdiff_t>(slice.pixels._length);
    slice.T_scanner_slice.translation_mm[2] += slice.thickness_mm * static_cast<double>(moved);
    slice.index = index;
  };
  in_order.procedure();
  mixed.procedure();
  ASSERT_EQ(mixed.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << mixed.state.text;
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(mixed.state.T_base_scanner.translation_mm[i], in_order.state.T_base_scanner.translation_mm[i], 1e-9);
  }
  EXPECT_EQ(mixed.state.slices_refused, 0U);
}

// A slice of another orientation that hides behind a slice of another series.
TEST(ScannerProcedure, MixedOrientationsAreFoundBehindAnotherSeries) {
  ScannerBench bench;
  bool other = false;
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (wire::view(slice.protocol) == "top" && slice.index == 30) {
      slice.series += 100;
      other = true;
    } else if (other && wire::view(slice.protocol) == "top" && slice.index == 31) {
      const double h = std::sqrt(0.5);
      slice.T_scanner_slice = {{h, h, 0, 0}, {-95, 0, -95}};
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "mixed orientations");
}

// ---- programs that end and come back ----

TEST(ScannerProcedure, AScannerThatIsStartedAgainCountsAnewAndIsUsed) {
  ScannerBench bench;
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  bench.scanner.health(1, 1, bregma_wire_DRIVER_CONNECTED);
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  bench.scanner.restart(); // with the order of the scout
  bench.scanner.health(2, 1, bregma_wire_DRIVER_CONNECTED);
  bench.step();
  bench.step();
  EXPECT_EQ(bench.state.activity, bregma_wire_SCANNER_FAILED);
  EXPECT_TRUE(says(bench.state.text, "the driver of Scanner was started again")) << bench.state.text;
  bench.let_pass(3'000'000'000); // longer than two programs of one name may be mistaken for each other
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_ACCEPT) << bench.state.text;
}

TEST(ScannerProcedure, AScannerThatEndsWithinASeriesEndsTheStepSoon) {
  ScannerBench bench;
  bench.scanner.health(1, 1, bregma_wire_DRIVER_CONNECTED);
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (slice.coil_state == bregma_wire_COILS_POSITIVE && slice.index > 40) {
      (void)wire::set_name(slice.device, "Elsewhere");
      bench.scanner.answers = false;
    }
  };
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  const std::int64_t began_ns = bench.now.utc_ns;
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_TRUE(says(bench.state.text, "the driver of Scanner has ended or is not reached")) << bench.state.text;
  EXPECT_LT(bench.now.utc_ns - began_ns, 15'000'000'000);
}

// Both were ordered; the second one's slices come first after a pause.
TEST(ScannerProcedure, BackgroundAndForegroundAreOfOneProgram) {
  ScannerBench bench;
  bool second = false;
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (slice.coil_state == bregma_wire_COILS_OFF && wire::view(slice.protocol) == "top" && slice.index == 60) {
      second = true;
    }
  };
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  while (!second) {
    bench.step();
  }
  bench.let_pass(3'000'000'000);
  bench.scanner.other_program();
  ASSERT_TRUE(bench.settle());
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "another program than before sends the slices of Scanner");
}

TEST(ScannerProcedure, AScannerThatWasNeverStartedIsSaidSoon) {
  ScannerBench bench;
  bench.topics.set_writers_alive<wire::ImageSlice>(0);
  bench.scanner.answers = false;
  bench.scanner.change = [](wire::ImageSlice &slice) { (void)wire::set_name(slice.device, "Elsewhere"); };
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  const std::int64_t began_ns = bench.now.utc_ns;
  EXPECT_EQ(bench.confirm("swap").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_TRUE(says(bench.state.text, "the driver of Scanner has ended or is not reached")) << bench.state.text;
  EXPECT_LT(bench.now.utc_ns - began_ns, 15'000'000'000);
}

TEST(ScannerProcedure, ACoilControllerThatIsLostWithinTheForegroundEndsTheStep) {
  ScannerBench bench;
  bench.scanner.health(1, 1, bregma_wire_DRIVER_CONNECTED, "Coils");
  bool lost = false;
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (slice.coil_state == bregma_wire_COILS_POSITIVE && slice.index > 20 && !std::exchange(lost, true)) {
      bench.scanner.health(1, 2, bregma_wire_DRIVER_CONNECTED, "Coils"); // it has switched off, and connected again
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "the coil controller was lost within a series");
}

TEST(ScannerProcedure, ADaemonThatIsStartedAgainSwitchesTheCoilsOff) {
  ScannerBench bench;
  bench.step();
  EXPECT_TRUE(bench.scanner.patterns.empty());
  bench.scanner.health(1, 1, bregma_wire_DRIVER_CONNECTED, "Coils");
  bench.step();
  bench.step();
  EXPECT_EQ(bench.scanner.patterns, std::vector<std::string>{"background"});
  EXPECT_TRUE(bench.alarms.empty());
}

TEST(ScannerProcedure, ADaemonThatEndsSwitchesTheCoilsOff) {
  ScannerBench bench;
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  while (!bench.scanner.coils_on()) {
    bench.step();
  }
  bench.stage.reset();
  bench.topics.deliver();
  bench.scanner.advance(bench.now.utc_ns);
  EXPECT_FALSE(bench.scanner.coils_on());
}

TEST(ScannerProcedure, TheCoilsAreOrderedOffUntilThatIsConfirmed) {
  ScannerBench bench;
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  bench.scanner.answers = false;
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  for (int i = 0; i < 220; ++i) {
    bench.step();
  }
  EXPECT_TRUE(bench.alarms.contains("coils_on"));
  EXPECT_TRUE(says(bench.state.next, "the coils may carry current; disconnect it; then: mend it")) << bench.state.next;
  bench.scanner.answers = true;
  for (int i = 0; i < 220; ++i) {
    bench.step();
  }
  EXPECT_TRUE(bench.alarms.empty());
  EXPECT_TRUE(says(bench.state.next, "mend it")) << bench.state.next;
}

// The controller switches off by itself after the hold: the rest of the series would show no coil.
TEST(ScannerProcedure, AHoldThatEndsWithinTheForegroundEndsTheStep) {
  ScannerBench bench;
  bool passed = false;
  bench.scanner.change = [&](wire::ImageSlice &slice) {
    if (slice.coil_state == bregma_wire_COILS_POSITIVE && slice.index > 20 && !std::exchange(passed, true)) {
      bench.let_pass(900'000'000'000);
    }
  };
  bench.procedure();
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "the coils were on for 900 s");
  EXPECT_TRUE(says(bench.state.next, "scanner.hold_s")) << bench.state.next;
}

TEST(ScannerProcedure, AReplyWithoutTheLastSlicesEndsTheStepSoon) {
  ScannerBench bench;
  bench.scanner.change = [](wire::ImageSlice &slice) {
    if (slice.coil_state == bregma_wire_COILS_POSITIVE && slice.index > 50) {
      (void)wire::set_name(slice.device, "Elsewhere");
    }
  };
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  const std::int64_t began_ns = bench.now.utc_ns;
  EXPECT_EQ(bench.confirm("top").result, bregma_wire_COMMAND_DONE);
  ASSERT_TRUE(bench.settle());
  expect_failed(bench, bregma_wire_SCANNER_STEP_TOP, "50 of 60 slices came, then no more");
  EXPECT_LT(bench.now.utc_ns - began_ns, 6'000'000'000);
}

TEST(ScannerProcedure, TheAnswerToACommandComesAfterTheStateThatItLedTo) {
  ScannerBench bench;
  bench.now.tick = false; // triggered by a sample
  EXPECT_EQ(bench.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result,
            bregma_wire_COMMAND_DONE);
  EXPECT_EQ(bench.state.step, bregma_wire_SCANNER_STEP_SWAP);
}

} // namespace
} // namespace bregma::server::testing
