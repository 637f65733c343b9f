# Pictures compared: equal, different, of different size, not pictures.
printf 'P6\n16 16\n255\n' >a.ppm
head -c 768 /dev/zero >>a.ppm
printf 'P6\n16 16\n255\n' >b.ppm
head -c 768 /dev/zero | tr '\0' '\377' >>b.ppm
printf 'P6\n12 16\n255\n' >c.ppm
head -c 576 /dev/zero >>c.ppm
printf 'P6\n16 16\n255\nxx' >cut.ppm
pbs-compare a.ppm b.ppm a.ppm
pbs-compare --json a.ppm a.ppm
status pbs-compare c.ppm a.ppm
status pbs-compare cut.ppm a.ppm
status pbs-compare gone.ppm a.ppm
