# Report.pm: what scripts/report and scripts/scaling do with their figures: kept from run to run, as
# tables, as curves with their Pareto front, and as one page of HTML.
package Report;
use strict;
use warnings;
use JSON::PP ();

# dir: of the report. total: cells that there will be, for the progress line.
sub new {
    my ($class, $dir, $total) = @_;
    my $self = bless { dir => $dir, total => $total, done => 0, body => '', start => time, fresh => 0 }, $class;
    mkdir $_ for $dir, "$dir/cells", "$dir/pictures";
    return $self;
}

# ---- cells: one measurement each, which an earlier run may have made already ----

# Figures of earlier runs are kept if these had the same key: they are of one scene and one build.
sub same_as {
    my ($self, $key) = @_;
    my ($file, $old) = ("$self->{dir}/cells/key", '');
    $old = slurp($file) if -e $file;
    return if $old eq $key;
    unlink glob "'$self->{dir}/cells/*.json'";
    open my $f, '>', $file or die "$file: $!\n";
    print $f $key;
    close $f or die "$file: $!\n";
}

# The figures that make_it returns, a hash, kept under that name. A cell that failed is a hash with
# the one member "failed", its message, and is tried again the next time.
sub cell {
    my ($self, $name, $make_it) = @_;
    my $file = "$self->{dir}/cells/" . ($name =~ s/[^\w.+-]/_/gr) . '.json';
    $self->{done}++;
    $self->progress($name);
    my $known = eval { JSON::PP::decode_json(slurp($file)) };
    return $known if ref $known eq 'HASH';
    my $new = eval { $make_it->() };
    if (!$new) {
        chomp(my $why = $@);
        print STDERR "\r\033[K" if -t STDERR;
        print STDERR "report: $name: $why\n";
        return { failed => $why };
    }
    $self->{fresh}++;
    open my $f, '>', "$file.new" or die "$file.new: $!\n";
    print $f JSON::PP->new->canonical->encode($new);
    close $f or die "$file.new: $!\n";
    rename "$file.new", $file or die "$file: $!\n";
    return $new;
}

sub progress {
    my ($self, $name) = @_;
    return unless -t STDERR;
    printf STDERR "\r\033[K%d/%d, %d s: %s", $self->{done}, $self->{total}, time - $self->{start}, $name;
    print STDERR "\r\033[K" if $self->{done} >= $self->{total};
}

# ---- tables ----

sub number {
    my $v = shift;
    return '-' unless defined $v;
    return $v unless $v =~ /^-?[\d.]+(e[-+]?\d+)?$/i;
    return $v if $v =~ /^-?\d+$/;
    return $v == 0 ? '0' : abs $v >= 1e5 || abs $v < 1e-3 ? sprintf('%.3g', $v) : sprintf('%.4g', $v);
}

sub escape { my $t = shift; $t =~ s/&/&amp;/g; $t =~ s/</&lt;/g; $t =~ s/>/&gt;/g; $t =~ s/"/&quot;/g; return $t }

sub html { my $self = shift; $self->{body} .= join '', @_, "\n" }
sub heading { my ($self, $text) = @_; $self->html('<h2>', escape($text), '</h2>') }
sub text { my ($self, @text) = @_; $self->html('<p>', join(' ', @text), '</p>') }

# What the columns of the tables mean, and their units; each is in the manual page that is named.
my %measure = (
    settings => ['options of pbs-gbuffer and pbs-sample'],
    stage    => ['the program, without pbs-'],
    kind     => ['what is packed or drawn; of the limit of memory: which pipe'],
    input    => ['triangles of a generated mesh, or the scene of the report'],
    size     => ['of scaling: triangles; of pictures: pixels of a surfel or voxel (--surfel-size)', 'pbs-view'],
    codec    => ['--codec', 'pbs-flatten'],
    stored   => ['how positions are kept', 'pbs-container'],
    camera   => ['near, middle or far'],
    limit    => ['-m', 'pbs'],
    weight   => ['-w', 'pbs-sample'],
    threads  => ['-j', 'pbs'],
    seconds       => ['seconds of the clock', 'pbs'],
    cpu_seconds   => ['CPU seconds of all threads, user and system', 'pbs'],
    gbuffer_s     => ['cpu_seconds of pbs-gbuffer', 'pbs'],
    sample_s      => ['cpu_seconds of pbs-sample', 'pbs'],
    voxelize_s    => ['cpu_seconds of pbs-voxelize', 'pbs'],
    simplify_s    => ['cpu_seconds of pbs-simplify', 'pbs'],
    flatten_s     => ['cpu_seconds of pbs-flatten', 'pbs'],
    unpack_s      => ['cpu_seconds of pbs-info --check', 'pbs'],
    memory_counted  => ['bytes; the most that was counted at a time, what -m limits', 'pbs'],
    memory_resident => ['bytes; the most that the process occupied, mapped files included', 'pbs'],
    bytes      => ['of the result', 'pbs'],
    bytes_each => ['bytes of the result for each point'],
    triangles  => ['of the scene, every instance counted', 'pbs-import'],
    points     => ['surfels, or points of a cloud', 'pbs-flatten'],
    candidates => ['of all nodes', 'pbs-gbuffer'],
    surfels    => ['of all nodes; of pictures: those that are drawn', 'pbs-sample'],
    voxels     => ['of the finest level; of pictures: those that are drawn', 'pbs-voxelize'],
    resolution => ['voxels along an axis of the cube', 'pbs-voxelize'],
    error      => ['covering_radius and 0.7 pixels of the views, in the unit of the scene'],
    error_largest   => ['the largest error of any node, in the unit of the scene', 'pbs-sample'],
    covering_radius => ['distance D of the candidate farthest from all surfels, at the root, in the unit of the scene', 'pbs-sample'],
    min_spacing     => ['least spacing of a surfel, at the root, in the unit of the scene', 'pbs-sample'],
    holes           => ['wrong-side holes: share of the candidates, 0 to 1', 'pbs-sample'],
    colour_error    => ['root mean square of 1/255 of sRGB', 'pbs-sample'],
    error_bound     => ['half the diagonal of a voxel, in the unit of the scene', 'pbs-voxelize'],
    distance_mean   => ["of a voxel's middle from the surface in it, in the unit of the scene", 'pbs-voxelize'],
    distance_max    => ['the largest such distance', 'pbs-voxelize'],
    normal_mean     => ['degrees between the normal of a voxel and those of its triangles', 'pbs-voxelize'],
    normal_max      => ['the largest such angle', 'pbs-voxelize'],
    area            => ['of all triangles, in squares of the unit', 'pbs-voxelize'],
    area_kept       => ['what of it lies in voxels of the result', 'pbs-voxelize'],
    position_error       => ['largest movement of a position by quantisation, in the unit of the scene', 'pbs-flatten'],
    position_error_bound => ['what of it is promised', 'pbs-flatten'],
    gpu_ms  => ['milliseconds of the graphics processor, or of what stands for it', 'pbs-view'],
    cpu_ms  => ['milliseconds until the commands of a frame are given', 'pbs-view'],
    wall_ms => ['milliseconds until a frame is done', 'pbs-view'],
    ssim        => ['mean structural similarity to the geometry; 1 is equal', 'pbs-compare'],
    psnr_db     => ['peak signal-to-noise ratio, dB', 'pbs-compare'],
    hole_share  => ['share of the covered pixels of the geometry that the picture lacks', 'pbs-compare'],
    spill_share => ['share of the covered pixels of the picture that the geometry lacks', 'pbs-compare'],
    time      => ['exponent of cpu_seconds'],
    explained => ['share of the variance that it explains, 0 to 1'],
    counted   => ['exponent of memory_counted without the 6 MiB of a program'],
    resident  => ['exponent of memory_resident'],
    written   => ['exponent of bytes'],
    map({ ("${_}_large" => ['the same, from a tenth of the largest size on']) } qw(time counted resident written)),
    speed     => ['seconds of the first row of the stage in these'],
    cpu_ratio => ['cpu_seconds in those of the first row of the stage'],
);

# rows: hashes; columns: their members in order. Also written as NAME.tsv. A row with the member
# "mark" (default, pareto) is shown so.
sub table {
    my ($self, $name, $columns, $rows) = @_;
    $self->{columns}{$_}++ for @$columns;
    open my $f, '>', "$self->{dir}/$name.tsv" or die "$self->{dir}/$name.tsv: $!\n";
    print $f join("\t", @$columns), "\n";
    print $f join("\t", map { $_ // '' } @$_{@$columns}), "\n" for @$rows;
    close $f or die "$name.tsv: $!\n";
    my $t = '<div class="wide"><table><tr>' . join('', map { '<th>' . escape($_) . '</th>' } @$columns) . '</tr>';
    for my $row (@$rows) {
        my $mark = $row->{mark} // '';
        $t .= qq(<tr class="$mark">) . join('', map { '<td>' . escape(number($_)) . '</td>' } @$row{@$columns}) . '</tr>';
    }
    $self->html($t, '</table></div>', qq(<p class="file"><a href="$name.tsv">$name.tsv</a></p>));
}

# The columns of all tables so far, each with its meaning.
sub legend {
    my $self = shift;
    $self->heading('Measures');
    $self->html('<dl>');
    for (sort keys %{ $self->{columns} }) {
        my ($means, $page) = @{ $measure{$_} // die "$_: a measure without a word\n" };
        my $section = !$page ? '' : ' (' . $page . ($page eq 'pbs' ? '(7)' : $page eq 'pbs-container' ? '(5)' : '(1)') . ')';
        $self->html("<dt>$_</dt><dd>", escape("$means$section"), '</dd>');
    }
    $self->html('</dl>');
}

# Of points with a price and an error, those that nothing beats in both.
sub pareto {
    my ($rows, $price, $error) = @_;
    my ($least, @front) = (9**9**9);
    for my $row (sort { $a->{$price} <=> $b->{$price} || $a->{$error} <=> $b->{$error} } grep { defined $_->{$error} } @$rows) {
        next unless $row->{$error} < $least;
        $least = $row->{$error};
        push @front, $row;
    }
    return @front;
}

# ---- curves ----

sub have_gnuplot { return !system('command -v gnuplot >/dev/null 2>&1') }

# Of a middle lightness, so that they can be told from a light and from a dark ground.
my @colours = ('#3573b9', '#c8601a', '#2a8f5a', '#8a5bc7', '#a5791a', '#c04a90');

# Series: [label, rows]; a cross is the default's (crossed: another word for it), the grey line the
# Pareto front of all. Drawn as NAME.svg and into the page. better: 'less' or 'more' of y; without it
# there is no front. linear: y is not logarithmic. names: the member that is written beside a point.
# more: rows of no series, of which those marked are crossed. each: a front for each series.
sub plot {
    my ($self, $name, %how) = @_;
    my ($x, $y) = @how{qw(x y)};
    my $drawn = sub { my $v = shift; ($v->{$x} // 0) > 0 && ($v->{$y} // '') =~ /^-?[.\d]/ && ($how{linear} || $v->{$y} > 0) };
    my @series = grep { @{ $_->[1] } } map { [$_->[0], [grep { $drawn->($_) } @{ $_->[1] }]] } @{ $how{series} };
    return unless @series;
    unless (have_gnuplot()) { $self->text("No plot $name: gnuplot is not installed."); return }
    my @all = map { @{ $_->[1] } } @series;
    my ($sign, @lines) = (($how{better} // '') eq 'more' ? -1 : 1);
    for my $of (!$how{better} ? () : $how{each} ? map({ $_->[1] } @series) : \@all) {
        my @front = pareto([map { { %$_, price => $sign * $_->{$y} } } @$of], $x, 'price');
        push @lines, [@lines ? '' : 'Pareto front', \@front, q(with steps lw 5 lc rgb '#b0b0b0')];
    }
    push @lines, [@{ $series[$_] }, "with linespoints pt 7 ps 0.6 lw 1.5 lc rgb '$colours[$_ % @colours]'"] for 0 .. $#series;
    push @lines, [$how{crossed} // 'default', [grep { ($_->{mark} // '') eq 'default' } @all, grep { $drawn->($_) } @{ $how{more} // [] }], q(with points pt 2 ps 1.6 lw 2 lc rgb '#d02020')];
    push @lines, ['', \@all, q(using 1:2:3 with labels offset 0,0.9 font ',11')] if $how{names};
    return $self->text("No plot $name: gnuplot failed.") unless $self->draw($name, \%how, @lines);
    my $svg = slurp("$self->{dir}/$name.svg");
    $svg =~ s/^.*?(?=<svg)//s;
    # Names of several drawings in one page must not be the same.
    $svg =~ s/\b(id=["']|href=["']#|url\(["']?#)gp/$1${name}_gp/g;
    $svg =~ s/\bid="gnuplot_plot/id="${name}_plot/g;
    $svg =~ s/<svg/<svg role="img" aria-label="$name"/;
    $self->html('<figure>', $svg, '<figcaption>', escape($how{caption}), '</figcaption></figure>');
}

# Lines: [label, rows, style]. False if gnuplot fails.
sub draw {
    my ($self, $name, $how, @lines) = @_;
    my ($x, $y, $names) = @$how{qw(x y names)};
    my $data = "$self->{dir}/cells/$name.dat";
    open my $f, '>', $data or die "$data: $!\n";
    my @plots;
    for (grep { @{ $_->[1] } } @lines) {
        my ($label, $rows, $style) = @$_;
        my $title = length $label ? 'title ' . quoted($label) : 'notitle';
        print $f map({ join(' ', @$_{$x, $y}, $names ? $_->{$names} : ()) . "\n" } sort { $a->{$x} <=> $b->{$x} } @$rows), "\n\n";
        push @plots, quoted($data) . ' index ' . scalar(@plots) . ($style =~ /^using/ ? " $style notitle" : " $title $style");
    }
    close $f or die "$data: $!\n";
    my $log = $how->{linear} ? 'x' : 'xy';
    my ($least, $most) = (sort { $a <=> $b } map { map { $_->{$y} } @{ $_->[1] } } @lines)[0, -1];
    my $range = $how->{linear} && $least == $most ? 'set yrange [0:' . (2 * $least || 1) . '];' : '';
    open my $g, '|-', 'gnuplot' or die "gnuplot: $!\n";
    print $g "set terminal svg size 760,420 dynamic font 'sans,13'; set output ", quoted("$self->{dir}/$name.svg"), "; set logscale $log; $range set format '%g'; set grid lc rgb '#cccccc';
        set key outside top center horizontal noenhanced; set xlabel ", quoted($how->{xlabel}), '; set ylabel ', quoted($how->{ylabel}), '; plot ', join(', ', @plots), "\n";
    return close $g;
}
sub quoted { my $text = shift; return "'" . ($text =~ s/'/''/gr) . "'" }
sub slurp { open my $f, '<', $_[0] or die "$_[0]: $!\n"; local $/; return scalar <$f> }

# A picture (PNG) inside of the page.
sub picture {
    my ($self, $file, $caption) = @_;
    open my $f, '<:raw', $file or return;
    local $/;
    require MIME::Base64;
    my $bytes = MIME::Base64::encode_base64(<$f>, '');
    $self->html(qq(<figure class="picture"><img alt="), escape($caption), qq(" src="data:image/png;base64,$bytes"><figcaption>), escape($caption), '</figcaption></figure>');
}

# ---- the page ----

# NAME.html.
sub page {
    my ($self, $name, $title, $lead) = @_;
    open my $f, '>', "$self->{dir}/$name.html" or die "$self->{dir}/$name.html: $!\n";
    print $f <<"HTML";
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>@{[escape($title)]}</title>
<style>
:root { color-scheme: light dark; --line: #ccc; --soft: #f4f4f2 }
body { font: 16px/1.5 sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; font-size: 0.82rem; font-variant-numeric: tabular-nums }
th, td { text-align: right; padding: 0.15rem 0.6rem; border-bottom: 1px solid var(--line); white-space: nowrap }
th:first-child, td:first-child { text-align: left }
tr.default td { font-weight: bold } tr.pareto td { background: var(--soft) }
.wide { overflow-x: auto } .file { font-size: 0.8rem; margin-top: 0.2rem }
figure { margin: 1rem 0 } figure svg { width: 100%; height: auto } figcaption { font-size: 0.85rem }
figure.picture { display: inline-block; width: 19%; margin: 0 0.5% } figure.picture img { width: 100% }
dl { display: grid; grid-template-columns: max-content auto; gap: 0.1rem 1rem; font-size: 0.85rem } dd { margin: 0 }
pre { background: var(--soft); padding: 0.8rem; overflow-x: auto }
\@media (prefers-color-scheme: dark) {
    :root { --line: #444; --soft: #242424 } body { background: #161616; color: #ddd }
    figure svg { filter: invert(0.9) hue-rotate(180deg) } a { color: #8ab4f8 }
}
</style></head><body>
<h1>@{[escape($title)]}</h1>
<p>$lead</p>
$self->{body}</body></html>
HTML
    close $f or die "$name.html: $!\n";
}

1;
