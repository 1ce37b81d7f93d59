"""Where panels really hang, from photographs of the boards of markers that they show.

::

    opencv      OpenCV, or how to install it
    boards      which marker lies where on which panel; the boards as pictures
    detect      photograph -> markers with sub-pixel corners
    camera      the camera's intrinsics: projecting, files
    poses       rigid motions: composing, fitting, into and out of panels
    observations  what the photographs saw, as arrays
    chain       first guesses: the camera, then photographs and panels one after the other
    adjust      all at once: the bundle adjustment, its outliers and its covariance
    solve       the sentence: photographs -> calibrated display
    overlay     photographs with what was found in them
    rehearse    synthetic photographs of a display with known errors, to know what to expect
"""
