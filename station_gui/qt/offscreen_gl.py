"""OpenGL that draws into pictures.

A QOpenGLWidget makes Qt compose the whole window anew with each repaint of any widget in it, which costs more than
the 3D scene itself where OpenGL is in software. A picture is repainted like any other widget, and only when the
scene has changed.
"""

from __future__ import annotations

from collections.abc import Callable

from OpenGL import GL
from PySide6.QtCore import QSize
from PySide6.QtGui import QImage, QOffscreenSurface, QOpenGLContext
from PySide6.QtOpenGL import QOpenGLFramebufferObject, QOpenGLFramebufferObjectFormat

_OLDEST_OPENGL = (2, 1)  # pyqtgraph draws with nothing older


class OpenGlError(Exception):
    """This display cannot draw with OpenGL."""


class OffscreenGl:
    """A context with a frame buffer that takes the size of each picture."""

    def __init__(self) -> None:
        self._buffer: QOpenGLFramebufferObject | None = None
        self._made_for = QSize(), 0
        self.context = QOpenGLContext()
        shared = QOpenGLContext.globalShareContext()
        if shared is not None:
            self.context.setShareContext(shared)
        if not self.context.create():
            raise OpenGlError("there is no OpenGL on this display")
        self._surface = QOffscreenSurface()
        self._surface.setFormat(self.context.format())
        self._surface.create()
        version = tuple(self.context.format().version())
        if version < _OLDEST_OPENGL:
            raise OpenGlError(f"OpenGL {version[0]}.{version[1]} is too old")
        self._make_current()
        self.in_software = _renderer_is_software()

    def _make_current(self) -> None:
        if not self._surface.isValid() or not self.context.makeCurrent(self._surface):
            raise OpenGlError("the OpenGL context cannot be used")

    def picture(self, width_px: int, height_px: int, samples: int, paint: Callable[[], None]) -> QImage:
        """What `paint` draws with this context current, at this size; OpenGlError when it cannot.

        `samples` for each pixel make edges smooth, 0 leaves them as they are.
        """
        self._make_current()
        buffer = self._buffer_of(QSize(width_px, height_px), samples)
        if not buffer.bind():
            raise OpenGlError("the frame buffer cannot be used")
        try:
            GL.glViewport(0, 0, width_px, height_px)
            paint()
        finally:
            buffer.release()
        image = buffer.toImage()
        image.reinterpretAsFormat(QImage.Format.Format_RGB32)  # the scene is opaque: converting would cost 6 ms
        return image

    def close(self) -> None:
        """Give the frame buffer back while its context still lives."""
        if self.context.makeCurrent(self._surface):
            self._buffer = None
            self.context.doneCurrent()

    def _buffer_of(self, size: QSize, samples: int) -> QOpenGLFramebufferObject:
        if self._buffer is None or (size, samples) != self._made_for:
            self._made_for = size, samples
            layout = QOpenGLFramebufferObjectFormat()
            layout.setAttachment(QOpenGLFramebufferObject.Attachment.CombinedDepthStencil)
            layout.setSamples(samples)
            self._buffer = QOpenGLFramebufferObject(size, layout)
        if not self._buffer.isValid():
            self._buffer = None
            raise OpenGlError(f"no frame buffer of {size.width()} x {size.height()} pixels")
        return self._buffer


def _renderer_is_software() -> bool:
    name = GL.glGetString(GL.GL_RENDERER) or b""
    return any(word in name.lower() for word in (b"llvmpipe", b"softpipe", b"swrast", b"software"))
