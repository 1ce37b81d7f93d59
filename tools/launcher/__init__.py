"""`./limen` in a checkout: decide what set-up is missing, do it once, then become the real command.

::

    main         arguments -> what the verb needs -> set-up if missing -> exec
    state        what has been done (the stamp), who may do it (the lock)       pure but for two small files
    environment  uv, .venv, limen and its dependencies
    driver       an adapter, or a software Vulkan driver where there is none
    checks       what `./limen test` runs, inside .venv

Only the standard library: it runs before anything is installed.
"""
