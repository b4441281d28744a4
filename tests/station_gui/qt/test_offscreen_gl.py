"""OpenGL into pictures."""

import pytest
from OpenGL import GL
from PySide6.QtGui import QColor, QGuiApplication

from station_gui.qt.offscreen_gl import OffscreenGl, OpenGlError


@pytest.fixture
def gl(qapp):
    if QGuiApplication.platformName() == "offscreen":
        pytest.skip("OpenGL needs a real or virtual X display")
    made = OffscreenGl()
    yield made
    made.close()


def clear_to(red, green, blue):
    def paint():
        GL.glClearColor(red, green, blue, 1.0)
        GL.glClear(GL.GL_COLOR_BUFFER_BIT)

    return paint


@pytest.mark.parametrize("samples", [0, 4])
def test_what_is_painted_is_in_the_picture(gl, samples):
    image = gl.picture(37, 21, samples, clear_to(1.0, 0.0, 0.5))
    assert (image.width(), image.height()) == (37, 21)
    assert QColor(image.pixel(20, 10)).getRgb()[:3] in {(255, 0, 127), (255, 0, 128)}


def test_a_picture_may_change_its_size(gl):
    for size in ((10, 10), (300, 200), (10, 10)):
        image = gl.picture(*size, 0, clear_to(0.0, 1.0, 0.0))
        assert (image.width(), image.height()) == size


def test_a_fault_while_painting_comes_out_and_the_next_picture_is_right(gl):
    def fail():
        raise ValueError("in the scene")

    with pytest.raises(ValueError, match="in the scene"):
        gl.picture(10, 10, 0, fail)
    assert QColor(gl.picture(10, 10, 0, clear_to(0.0, 0.0, 1.0)).pixel(5, 5)).blue() == 255


def test_a_picture_beyond_all_measure_is_an_error(gl):
    with pytest.raises(OpenGlError):
        gl.picture(1_000_000, 1_000_000, 0, clear_to(0.0, 0.0, 0.0))


def test_closing_twice_is_fine(gl):
    gl.close()
    gl.close()
