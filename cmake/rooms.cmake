# A room may include only its own headers and those of the rooms that its target links.
#
# bregma_room(FOLDER TARGET...): FOLDER is a room, compiled into these targets. Call it after their links are known. The test
# `rooms` compares every #include with these links (check_rooms.sh).
function(bregma_room folder)
  set_property(GLOBAL APPEND PROPERTY BREGMA_ROOM_FOLDERS ${folder})
  set_property(GLOBAL PROPERTY BREGMA_ROOM_${folder} ${ARGN})
endfunction()

# To be called once after all rooms: writes "folder|targets|links" for each, and adds the test.
function(bregma_check_rooms)
  get_property(folders GLOBAL PROPERTY BREGMA_ROOM_FOLDERS)
  set(table "")
  foreach(folder IN LISTS folders)
    get_property(targets GLOBAL PROPERTY BREGMA_ROOM_${folder})
    foreach(target IN LISTS targets)
      set(links "")
      foreach(property LINK_LIBRARIES INTERFACE_LINK_LIBRARIES)
        get_target_property(some ${target} ${property})
        if(some)
          list(APPEND links ${some})
        endif()
      endforeach()
      list(FILTER links INCLUDE REGEX "^bregma_")
      list(REMOVE_DUPLICATES links)
      string(REPLACE ";" " " links "${links}")
      string(APPEND table "${folder}|${target}|${links}\n")
    endforeach()
  endforeach()
  file(WRITE ${CMAKE_BINARY_DIR}/rooms.txt "${table}")
  add_test(NAME rooms COMMAND bash ${CMAKE_SOURCE_DIR}/cmake/check_rooms.sh ${CMAKE_BINARY_DIR}/rooms.txt ${CMAKE_SOURCE_DIR})
  set_tests_properties(rooms PROPERTIES LABELS unit)
endfunction()
