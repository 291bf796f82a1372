# cmake --install: programs, headers, IDL files, the CMake package, systemd unit, configuration, manual, completion, licence.
# bregma_install() is called once, when all targets are known.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(BREGMA_INCLUDE_DIR ${CMAKE_INSTALL_INCLUDEDIR}/bregma) # below it headers lie as in the tree: "idl/dds.hpp"
set(BREGMA_SHARE_DIR ${CMAKE_INSTALL_DATADIR}/bregma)

# The libraries of the package. Each is Bregma::NAME without the prefix bregma_, except for the wire: Bregma::wire is the
# wire with everything that a program needs to use it.
set(BREGMA_PACKAGE_TARGETS
  bregma_settings bregma_base bregma_wire bregma_wire_values bregma_idl bregma_driver bregma_algorithms
  bregma_geometry bregma_simd bregma_image bregma_parallel bregma_surface bregma_uncertainty bregma_registration bregma_intensity
  bregma_calibration bregma_mri bregma_monitoring bregma_planning bregma_range bregma_robot bregma_tissue_material bregma_tissue)
set(BREGMA_PACKAGE_HEADERS base idl algorithms drivers/frame)

function(bregma_install)
  foreach(target IN LISTS BREGMA_PACKAGE_TARGETS)
    string(REGEX REPLACE "^bregma_" "" name ${target})
    set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  endforeach()
  set_target_properties(bregma_idl PROPERTIES EXPORT_NAME wire)
  set_target_properties(bregma_wire PROPERTIES EXPORT_NAME wire_types)

  install(TARGETS bregmad bregma bregma-sim-room bregma-gateway bregma-case-server bregma-arm bregma-range)
  install(TARGETS ${BREGMA_PACKAGE_TARGETS} EXPORT BregmaTargets)
  foreach(folder IN LISTS BREGMA_PACKAGE_HEADERS)
    install(DIRECTORY ${folder}/ DESTINATION ${BREGMA_INCLUDE_DIR}/${folder} FILES_MATCHING PATTERN "*.hpp")
  endforeach()
  install(DIRECTORY ${CMAKE_BINARY_DIR}/idl/ DESTINATION ${BREGMA_INCLUDE_DIR}/wire FILES_MATCHING
    PATTERN "*.h" PATTERN "CMakeFiles" EXCLUDE)
  install(DIRECTORY idl/ DESTINATION ${BREGMA_SHARE_DIR}/idl FILES_MATCHING PATTERN "*.idl")

  set(package ${CMAKE_INSTALL_LIBDIR}/cmake/Bregma)
  install(EXPORT BregmaTargets NAMESPACE Bregma:: DESTINATION ${package})
  configure_package_config_file(cmake/BregmaConfig.cmake.in ${CMAKE_BINARY_DIR}/BregmaConfig.cmake
    INSTALL_DESTINATION ${package} PATH_VARS BREGMA_SHARE_DIR)
  # Before 1.0 a minor version may change what a program sees.
  write_basic_package_version_file(${CMAKE_BINARY_DIR}/BregmaConfigVersion.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${CMAKE_BINARY_DIR}/BregmaConfig.cmake ${CMAKE_BINARY_DIR}/BregmaConfigVersion.cmake
    DESTINATION ${package})

  install(FILES deploy/cyclonedds-local.xml deploy/cyclonedds-network.xml deploy/bregma-limits.conf
    deploy/bregma-sysctl.conf DESTINATION ${BREGMA_SHARE_DIR})
  install(DIRECTORY robots DESTINATION ${BREGMA_SHARE_DIR})
  install(FILES deploy/bregma-sysusers.conf DESTINATION lib/sysusers.d RENAME bregma.conf)
  install(FILES LICENSE README.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
  install(DIRECTORY docs examples DESTINATION ${CMAKE_INSTALL_DOCDIR})
  install(FILES deploy/README.md DESTINATION ${CMAKE_INSTALL_DOCDIR}/deploy)
  # What the programs say about themselves, from the programs that have just been installed.
  install(CODE "
    execute_process(COMMAND bash ${CMAKE_SOURCE_DIR}/deploy/install_generated.sh \"\$ENV{DESTDIR}\" \"\${CMAKE_INSTALL_PREFIX}\"
      ${PROJECT_VERSION} COMMAND_ERROR_IS_FATAL ANY)")
endfunction()
