"""A headless OpenGL context made with EGL alone.

PyOpenGL can serve only one platform per process: once it has served EGL to MuJoCo, Qt's OpenGL windows in the same
process stay blank. These few calls to libEGL leave PyOpenGL alone, so a test may hold a simulator and a window.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator

from robot_app.drivers.base import DeviceError

_EGL_PLATFORM_DEVICE = 0x313F
_EGL_PLATFORM_SURFACELESS = 0x31DD
_EGL_DRAW, _EGL_READ = 0x3059, 0x305A
_EGL_OPENGL_API = 0x30A2
_EGL_NONE = 0x3038
_MAX_DEVICES = 16
# red, green, blue, alpha, depth and stencil bits; a pbuffer; desktop OpenGL
_ATTRIBUTES = (0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8, 0x3025, 24, 0x3026, 8, 0x3033, 1, 0x3040, 8, _EGL_NONE)

_Handle = ctypes.c_void_p


class _Glx:
    """The window system's own contexts: a thread that has one current is refused an EGL context."""

    def __init__(self) -> None:
        try:
            self._gl: ctypes.CDLL | None = ctypes.CDLL("libGLX.so.0")
        except OSError:  # without this library nobody in this process can have such a context
            self._gl = None
            return
        for name in ("glXGetCurrentDisplay", "glXGetCurrentContext"):
            getattr(self._gl, name).restype = _Handle
        self._gl.glXGetCurrentDrawable.restype = ctypes.c_ulong
        self._gl.glXMakeCurrent.argtypes = [_Handle, ctypes.c_ulong, _Handle]

    @contextlib.contextmanager
    def set_aside(self) -> Iterator[None]:
        """Leave the thread without such a context for a while."""
        gl = self._gl
        context = None if gl is None else gl.glXGetCurrentContext()
        if gl is None or not context:
            yield
            return
        display, drawable = gl.glXGetCurrentDisplay(), gl.glXGetCurrentDrawable()
        gl.glXMakeCurrent(display, 0, None)
        try:
            yield
        finally:
            gl.glXMakeCurrent(display, drawable, context)


class EglContext:
    """An OpenGL context with no surface; to be used in the thread that made it."""

    def __init__(self) -> None:
        try:
            self._egl = ctypes.CDLL("libEGL.so.1")
        except OSError as error:
            raise DeviceError(f"depth camera: no EGL for off-screen rendering (install libegl1): {error}") from error
        self._glx = _Glx()
        self._declare()
        self._display = self._first_display()
        self._context = self._make_context()

    @contextlib.contextmanager
    def current(self) -> Iterator[None]:
        """Make the context current in this thread and put back what was current before."""
        egl = self._egl
        with self._glx.set_aside():
            before = egl.eglGetCurrentDisplay(), egl.eglGetCurrentContext()
            surfaces = egl.eglGetCurrentSurface(_EGL_DRAW), egl.eglGetCurrentSurface(_EGL_READ)
            egl.eglBindAPI(_EGL_OPENGL_API)
            if not egl.eglMakeCurrent(self._display, None, None, self._context):
                raise DeviceError(f"depth camera: EGL error 0x{egl.eglGetError():04x} when making its context current")
            try:
                yield
            finally:
                egl.eglMakeCurrent(self._display, None, None, None)
                if before[1]:
                    egl.eglMakeCurrent(before[0], *surfaces, before[1])

    def close(self) -> None:
        if self._context:
            self._egl.eglDestroyContext(self._display, self._context)
            self._context = None

    def _declare(self) -> None:
        egl = self._egl
        for name in ("eglGetProcAddress", "eglGetCurrentDisplay", "eglGetCurrentContext", "eglCreateContext"):
            getattr(egl, name).restype = _Handle
        egl.eglGetCurrentSurface.restype = _Handle
        egl.eglGetCurrentSurface.argtypes = [ctypes.c_int]
        egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
        egl.eglInitialize.argtypes = [_Handle, _Handle, _Handle]
        egl.eglChooseConfig.argtypes = [_Handle, _Handle, _Handle, ctypes.c_int, _Handle]
        egl.eglCreateContext.argtypes = [_Handle, _Handle, _Handle, _Handle]
        egl.eglDestroyContext.argtypes = [_Handle, _Handle]
        egl.eglMakeCurrent.argtypes = [_Handle, _Handle, _Handle, _Handle]

    def _first_display(self) -> int:
        """The first display that initialises: surfaceless Mesa, then each device."""
        address = self._egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
        if not address:
            raise DeviceError("depth camera: this EGL cannot render off-screen")
        get_display = ctypes.CFUNCTYPE(_Handle, ctypes.c_uint, _Handle, _Handle)(address)
        for platform, device in [*((_EGL_PLATFORM_DEVICE, d) for d in self._devices()), (_EGL_PLATFORM_SURFACELESS, 0)]:
            display = get_display(platform, device, None)
            if display and self._egl.eglInitialize(display, None, None):
                return int(display)
        raise DeviceError("depth camera: no EGL display can be initialised")

    def _devices(self) -> list[int]:
        address = self._egl.eglGetProcAddress(b"eglQueryDevicesEXT")
        if not address:
            return []
        query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, _Handle, _Handle)(address)
        devices = (_Handle * _MAX_DEVICES)()
        count = ctypes.c_int(0)
        if not query(_MAX_DEVICES, devices, ctypes.byref(count)):
            return []
        return [d for d in devices[: count.value] if d]

    def _make_context(self) -> int | None:
        egl = self._egl
        attributes = (ctypes.c_int * len(_ATTRIBUTES))(*_ATTRIBUTES)
        config, count = _Handle(), ctypes.c_int(0)
        found = egl.eglChooseConfig(self._display, attributes, ctypes.byref(config), 1, ctypes.byref(count))
        if not found or count.value < 1:
            raise DeviceError("depth camera: EGL offers no frame buffer with 24 bits of depth")
        egl.eglBindAPI(_EGL_OPENGL_API)
        context = egl.eglCreateContext(self._display, config, None, None)
        if not context:
            raise DeviceError(f"depth camera: EGL error 0x{egl.eglGetError():04x} when making its context")
        return int(context)
