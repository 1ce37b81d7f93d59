"""Where panels really hang, from photographs of the boards of markers that they show.

::

    opencv        OpenCV, or how to install it
    boards        which marker lies where on which panel; the boards as pictures
    detect        photograph -> markers ...
    edges         ... with corners to a few hundredths of a pixel
    camera        the camera's intrinsics: projecting, files
    poses         rigid motions: composing, fitting, into and out of panels
    observations  what the photographs saw, as arrays
    islands       whether it hangs together
    chain         first guesses: the camera, then photographs and panels one after the other
    adjust        all at once: the bundle adjustment and its outliers
    precision     standard deviations of what was found
    solve         the sentence: photographs -> calibrated display
    overlay       photographs with what was found in them
    synthetic     photographs of a display whose every pixel is known
    rehearse      a calibration from these, to know what to expect
"""
