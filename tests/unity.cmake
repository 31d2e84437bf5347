# Compiles several test files as one unit, because most of the compile time goes into headers and
# instantiations that these files share.
#
# A unit first includes all headers of its files, then each file in its own namespace, so that
# helpers may have the same name in two files. (CMAKE_UNITY_BUILD has no such namespace.) A file
# that does not work inside a namespace is compiled alone: one that opens a namespace of the library
# or of another one, specialises a template of the library, defines macros, or includes a file that
# is not a header.

# Sets `out` to the files to compile for `sources`, with `batch` files in a unit. If `batch` is 0 or
# 1, these are the `sources` themselves.
function(clothctl_unity_sources out name batch sources)
  if(batch LESS 2)
    set(${out} ${sources} PARENT_SCOPE)
    return()
  endif()
  set(alone "")
  set(together "")
  foreach(source IN LISTS sources)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${source})
    file(READ ${source} text)
    if(text MATCHES "\n(namespace|struct|class|template)[^\n]* ?(clothctl|Catch|Eigen|std)[^\n]*{"
       OR text MATCHES "\n *# *define" OR text MATCHES "# *include \"[^\"]*\\.(inc|cpp)\""
       OR text MATCHES "# *include \"\\.\\./"
       OR text MATCHES "\n(extern|template (class|struct)|struct [a-z_]*traits<)")
      list(APPEND alone ${source})
    else()
      list(APPEND together ${source})
    endif()
  endforeach()

  list(LENGTH together count)
  math(EXPR units "(${count} + ${batch} - 1) / ${batch}")
  set(made "")
  if(units GREATER 0)
    math(EXPR each "(${count} + ${units} - 1) / ${units}")
    math(EXPR last "${units} - 1")
    foreach(unit RANGE ${last})
      math(EXPR first "${unit} * ${each}")
      list(SUBLIST together ${first} ${each} files)
      set(includes "")
      set(bodies "")
      foreach(source IN LISTS files)
        file(STRINGS ${source} lines REGEX "^ *# *include")
        list(APPEND includes ${lines})
        get_filename_component(stem ${source} NAME_WE)
        string(APPEND bodies "namespace unit_${stem} {\n#include \"${source}\"\n}\n")
      endforeach()
      list(REMOVE_DUPLICATES includes)
      list(JOIN includes "\n" includes)
      set(file ${CMAKE_CURRENT_BINARY_DIR}/unity/${name}_${unit}.cpp)
      file(CONFIGURE OUTPUT ${file} CONTENT "${includes}\n\n${bodies}" @ONLY)
      list(APPEND made ${file})
    endforeach()
  endif()
  set(${out} ${alone} ${made} PARENT_SCOPE)
endfunction()
