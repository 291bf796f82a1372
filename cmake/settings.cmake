# Build settings of all targets. Targets link bregma_settings; third-party headers are system headers.
add_library(bregma_settings INTERFACE)
target_include_directories(bregma_settings INTERFACE
  $<BUILD_INTERFACE:${CMAKE_SOURCE_DIR}> $<INSTALL_INTERFACE:${BREGMA_INCLUDE_DIR}>)
target_compile_features(bregma_settings INTERFACE cxx_std_20)
# x86-64-v2 runs on every 64-bit machine in use. The release-v3 preset selects faster code.
set(BREGMA_MARCH "x86-64-v2" CACHE STRING "Instruction set to build for")
# Programs that link the package are built for it as well: Eigen's alignment depends on it.
target_compile_options(bregma_settings INTERFACE -march=${BREGMA_MARCH})
target_compile_options(bregma_settings INTERFACE $<BUILD_INTERFACE:
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wnon-virtual-dtor -Werror
  # GCC 12 sees overlaps in std::string's own operator+ (GCC bug 105651), and takes the files of a unity build for headers.
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict -Wno-subobject-linkage>>>)

if(BREGMA_SANITIZE)
  # GCC 12, with sanitizers, takes std::regex for uninitialized (GCC bug 105562). That for threads does not know the fences of Asio.
  target_compile_options(bregma_settings INTERFACE $<BUILD_INTERFACE:$<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized -Wno-tsan>>)
  add_compile_options(-fsanitize=${BREGMA_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${BREGMA_SANITIZE})
endif()

# bregma_test(NAME test_x SOURCES ... LIBRARIES ... [LABEL unit] [TIMEOUT s] [ALONE]): one GoogleTest program, its tests known
# to CTest by name and label. ALONE: no other test runs beside its tests, because they depend on time.
function(bregma_test)
  cmake_parse_arguments(arg "ALONE" "NAME;LABEL;TIMEOUT" "SOURCES;LIBRARIES" ${ARGN})
  if(NOT arg_LABEL)
    set(arg_LABEL unit)
  endif()
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 120)
  endif()
  if(BREGMA_SANITIZE)
    math(EXPR arg_TIMEOUT "5 * ${arg_TIMEOUT}")
  endif()
  add_executable(${arg_NAME} ${arg_SOURCES})
  target_link_libraries(${arg_NAME} PRIVATE bregma_settings ${arg_LIBRARIES} GTest::gtest GTest::gtest_main)
  include(GoogleTest)
  # Read only by sanitized tests and the daemons that they start.
  set(environment LSAN_OPTIONS=suppressions=${CMAKE_SOURCE_DIR}/tests/support/lsan.supp)
  if(BREGMA_SANITIZE MATCHES thread)
    set(environment TSAN_OPTIONS=suppressions=${CMAKE_SOURCE_DIR}/tests/support/tsan.supp)
  endif()
  gtest_discover_tests(${arg_NAME} DISCOVERY_TIMEOUT 60 PROPERTIES LABELS ${arg_LABEL} TIMEOUT ${arg_TIMEOUT}
    ENVIRONMENT ${environment} RUN_SERIAL ${arg_ALONE})
endfunction()
