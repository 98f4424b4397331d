"""Writes the fixtures beside it with the reference implementation of each format.

python3 -m pip install nibabel pynrrd SimpleITK numpy && python3 make.py

Every file holds the same 3 x 4 x 5 lattice: sample (x, y, z) is 1 + x + 10 y + 50 z (u8: halved and rounded down).
Oriented files have spacing 0.5, 0.75, 2 along axes turned 30 degrees about z, and their first sample at (7, -8, 9)
of their own space.
"""
import gzip, math, os
import nibabel as nib, nrrd, numpy as np, SimpleITK as sitk

os.chdir(os.path.dirname(os.path.abspath(__file__)))
x, y, z = np.meshgrid(np.arange(3), np.arange(4), np.arange(5), indexing="ij")
a = 1 + x + 10 * y + 50 * z
c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
matrix = rotation * np.array([0.5, 0.75, 2.0])
affine = np.eye(4)
affine[:3, :3], affine[:3, 3] = matrix, (7, -8, 9)

# NIfTI: every real type, both byte orders, both versions, one file and two, sform and qform and neither.
for name in "int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64".split():
    data = (a // 2 if name.endswith("int8") else a).astype(name)
    image = nib.Nifti1Image(data, affine, dtype=name)
    nib.save(image, f"n1_{name}.nii")
big = nib.Nifti1Image(a.astype(">i2"), affine, header=nib.Nifti1Header(endianness=">"))
big.header.set_slope_inter(2.0, -100.0)
big.header.set_data_dtype(">i2")
raw = big.header.copy()
raw["vox_offset"], raw["magic"] = 352, b"n+1"
with open("n1_big_rescaled.nii", "wb") as f:
    f.write(raw.binaryblock + b"\0" * 4 + a.astype(">i2").tobytes(order="F"))
nib.save(nib.Nifti2Image(a.astype("i2"), affine), "n2.nii.gz")
qform = nib.Nifti1Image(a.astype("i2"), None)
left_handed = affine.copy()
left_handed[:3, 2] *= -1
qform.set_qform(left_handed, code=1)
qform.set_sform(None, code=0)
nib.save(qform, "n1_qform.nii")
plain = nib.Nifti1Image(a.astype("i2"), None)
plain.header.set_zooms((0.5, 0.75, 2.0))
nib.save(plain, "n1_plain.nii")
nib.save(nib.Nifti1Pair(a.astype("i2"), affine), "n1_pair.img")

# NRRD: encodings, spaces, detached header.
def put(name, data, **header):
    nrrd.write(name, data, {k.replace("_", " "): v for k, v in header.items()}, index_order="F")
lps = dict(space="left-posterior-superior", space_directions=matrix.T, space_origin=[7, -8, 9])
put("raw.nrrd", a.astype("<i2"), encoding="raw", **lps)
put("gzip.nrrd", a.astype("<f4"), encoding="gzip", **lps)
put("ascii.nrrd", a.astype("<i4"), encoding="ascii", **lps)
put("big.nrrd", a.astype(">u2"), encoding="raw", endian="big", **lps)
put("ras.nrrd", a.astype("<i2"), encoding="raw", **{**lps, "space": "right-anterior-superior"})
put("spacings.nrrd", a.astype("<i2"), encoding="gzip", spacings=[0.5, 0.75, 2.0])
put("split.nhdr", a.astype("<f8"), encoding="raw", **lps)

# MetaImage: attached and detached, compressed or not.
image = sitk.GetImageFromArray(a.transpose(2, 1, 0).astype("int16"))
image.SetSpacing((0.5, 0.75, 2.0)); image.SetOrigin((7, -8, 9)); image.SetDirection(rotation.ravel())
sitk.WriteImage(image, "local.mha")
sitk.WriteImage(image, "packed.mha", True)
sitk.WriteImage(sitk.Cast(image, sitk.sitkFloat32), "detached.mhd")
sitk.WriteImage(sitk.Cast(image, sitk.sitkUInt32), "packed.mhd", True)

# NumPy: C and Fortran order, both byte orders.
array = a.transpose(2, 1, 0)
np.save("c.npy", np.ascontiguousarray(array.astype("<f4")))
np.save("fortran.npy", np.asfortranarray(array.astype("<u2")))
np.save("big.npy", np.ascontiguousarray(array.astype(">i4")))
